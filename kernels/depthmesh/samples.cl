/* Segmentation of a depth image, positions of the vertices at the border, and normals of the samples.
 *
 * `segment` finds the triangles that bridge two surfaces (rubber sheets), which are not drawn. TEST_ORTHOGONALITY is
 * the test of the paper (Pajarola, Sainz & Meng 2003): such a triangle is seen edge-on (equation 3) and is long in
 * depth (equation 4). In orthographic views z has no fixed origin, so the depth range is relative to the view's extent.
 * Beyond the paper, triangles of a surface that continues straight, like a distant floor, are kept; the rule of
 * TEST_CONNECTEDNESS decides this, with a smaller gap. TEST_CONNECTEDNESS (Mark, McMillan & Bishop 1997): an edge is
 * kept if the nearness of its two samples differs little, or if the line through samples on one side continues along
 * the edge (in nearness, which is linear on planes). TEST_DISPARITY: a triangle is removed if the nearness of its
 * corners differs too much (Oliveira & Bishop 1998). TEST_NONE keeps all triangles. Beyond the papers, each test
 * ignores differences that the sensor's noise explains (`noise`).
 *
 * `place_border` computes the nearness of the vertices that are drawn half a pixel beyond the outermost samples: it
 * extends the line through the outermost sample and the next sample inside, so the surface passes through both samples.
 *
 * nearness: (height, pitch), picture/nearness.cl. cells: (height, pitch) states of each cell's two triangles (tree.h).
 * placed: (height, pitch) nearness of the drawn vertices: the samples' nearness except at the border.
 * normals: (3, height, pitch) unit normals in the view's frame, towards the camera, from the differences to neighbours
 * that share a drawn triangle; (0, 0, -1) without such neighbours.
 * Work-item: a row. Cost: O(samples). Determinism: samples are independent.
 */
#include "depthmesh/tree.h"

#define TEST_ORTHOGONALITY 0
#define TEST_CONNECTEDNESS 1
#define TEST_DISPARITY 2
#define TEST_NONE 3
#define STRAIGHT 0.1f /* times `gap`: TEST_ORTHOGONALITY keeps surfaces that deviate less from a straight line */

typedef struct {
    int test;          /* TEST_...: decides which triangles are rubber sheets */
    float sine;        /* a triangle is edge-on if the sine of its angle to the line of sight is less */
    float depth_range; /* largest range of depths in a triangle of one surface, as a fraction of z or of the extent */
    float extent;      /* extent of an orthographic view's samples, in scene units */
    float gap;         /* largest difference of neighbours' nearness on a surface, divided by nearness or the extent */
    float noise[3];    /* a, b, c: depths of one surface may differ by a z z + b z + c at depth z */
} Segmentation;

#define SPREAD(a, b, c) (fmax(a, fmax(b, c)) - fmin(a, fmin(b, c)))

/* Is the triangle of the points p, q, r with nearness a, b, c a rubber sheet? */
INLINED intl bridges(const Layout *layout, const Segmentation *rule, Vector p, Vector q, Vector r, floatl a, floatl b, floatl c)
{
    if (rule->test == TEST_DISPARITY) {
        const floatl nearest = fmax(a, fmax(b, c)), scale = layout->perspective ? nearest : (floatl)rule->extent;
        return SPREAD(a, b, c) > fmax(rule->gap * scale, noise_of_nearness(layout, rule->noise, nearest));
    }
    if (rule->test != TEST_ORTHOGONALITY)
        return (intl)(p.z < -INFINITY);
    const Vector normal = cross_product(minus(q, p), minus(r, p));
    Vector sight = {0.0f, 0.0f, 1.0f};
    floatl scale = rule->extent;
    if (layout->perspective) {
        sight.x = p.x + q.x + r.x;
        sight.y = p.y + q.y + r.y;
        sight.z = p.z + q.z + r.z;
        scale = sight.z * (1.0f / 3.0f);
    }
    const floatl noise = NOISE_AT(rule->noise, (p.z + q.z + r.z) * (1.0f / 3.0f)),
                 allowed = fmax(rule->depth_range * scale, noise);
    const floatl along = DOT(sight, normal), sizes = DOT(sight, sight) * DOT(normal, normal);
    return (along * along < rule->sine * rule->sine * sizes) & (SPREAD(p.z, q.z, r.z) > allowed);
}

/* Do the sample (x, y) and the next sample along x, or y, belong to one surface? (dx, dy): (1, 0), or (0, 1) */
intl is_connected(const Layout *layout, const Segmentation *rule, global const float *nearness, intl x, intl y, int dx,
                  int dy)
{
    const intl right = (intl)(layout->width - 1), bottom = (intl)(layout->height - 1), none = (intl)0;
    const intl at_before = max(y - dy, none) * layout->pitch + max(x - dx, none);
    const intl at_a = min(y, bottom) * layout->pitch + min(x, right);
    const intl at_b = min(y + dy, bottom) * layout->pitch + min(x + dx, right);
    const intl at_after = min(y + 2 * dy, bottom) * layout->pitch + min(x + 2 * dx, right);
    const floatl before = (floatl)(gather(nearness, at_before)), a = (floatl)(gather(nearness, at_a)),
                 b = (floatl)(gather(nearness, at_b)), after = (floatl)(gather(nearness, at_after));
    const floatl step = b - a, scale = layout->perspective ? fmax(fabs(a), fabs(b)) : (floatl)rule->extent;
    const floatl on = select_lanes(IS_SAMPLE(before), fabs(step - (a - before)), fabs(step));
    const floatl back = select_lanes(IS_SAMPLE(after), fabs(step - (after - b)), fabs(step));
    const floatl allowed = fmax(rule->gap * scale, noise_of_nearness(layout, rule->noise, fmax(a, b)));
    return fmin(fmin(on, back), fabs(step)) <= allowed;
}

kernel void segment(global const float *nearness, global uchar *cells, Layout layout, Segmentation rule)
{
    const int y = get_global_id(0);
    if (y >= layout.height - 1)
        return;
    Segmentation straight = rule;
    if (rule.test == TEST_ORTHOGONALITY)
        straight.gap *= STRAIGHT;
    global const float *upper = nearness + (size_t)y * layout.pitch, *lower = upper + layout.pitch;
    for (int first = 0; first < layout.width - 1; first += LANES) {
        const floatl n[4] = {load_lanes(upper + first), load_lanes(upper + first + 1), load_lanes(lower + first),
                             load_lanes(lower + first + 1)};
        const intl x = first + lane_index, main = ((x ^ y) & 1) == 0;
        const floatl fx = to_floatl(x), fy = (floatl)y;
        Vector p[4];
        for (int k = 0; k < 4; k++)
            p[k] = point_of(&layout, fx + (k & 1), fy + (k >> 1), DEPTH_OF(layout.perspective, n[k]));
        /* Each triangle has both ends of the diagonal and one other corner. */
        const Vector a = {select_lanes(main, p[3].x, p[2].x), select_lanes(main, p[3].y, p[2].y),
                          select_lanes(main, p[3].z, p[2].z)};
        const Vector b = {select_lanes(main, p[0].x, p[1].x), select_lanes(main, p[0].y, p[1].y),
                          select_lanes(main, p[0].z, p[1].z)};
        const floatl na = select_lanes(main, n[3], n[2]), nb = select_lanes(main, n[0], n[1]);
        intl upper_drawn = IS_SAMPLE(n[0]) & IS_SAMPLE(n[1]) & IS_SAMPLE(na);
        intl lower_drawn = IS_SAMPLE(n[2]) & IS_SAMPLE(n[3]) & IS_SAMPLE(nb);
        const intl all = (intl)(rule.test == TEST_CONNECTEDNESS ? -1 : 0);
        const intl upper_bridges = all | bridges(&layout, &rule, p[0], p[1], a, n[0], n[1], na);
        const intl lower_bridges = all | bridges(&layout, &rule, p[2], p[3], b, n[2], n[3], nb);
        intl upper_on = 0, lower_on = 0;
        if (rule.test <= TEST_CONNECTEDNESS && any_lane((upper_drawn & upper_bridges) | (lower_drawn & lower_bridges))) {
            const intl row = (intl)y, left = is_connected(&layout, &straight, nearness, x, row, 0, 1);
            const intl right = is_connected(&layout, &straight, nearness, x + 1, row, 0, 1);
            upper_on = is_connected(&layout, &straight, nearness, x, row, 1, 0) & select_lanes(main, right, left);
            lower_on = is_connected(&layout, &straight, nearness, x, row + 1, 1, 0) & select_lanes(main, left, right);
        }
        upper_drawn = upper_drawn & (upper_on | !upper_bridges);
        lower_drawn = lower_drawn & (lower_on | !lower_bridges);
        const intl state = select_lanes(upper_drawn, (intl)DRAWN, (intl)UNDRAWN) |
                           select_lanes(lower_drawn, (intl)(DRAWN << 2), (intl)(UNDRAWN << 2));
        store_bytes(to_ucharl(select_lanes(x < layout.width - 1, state, (intl)0)),
                    cells + (size_t)y * layout.pitch + first);
    }
}

/* States of the cell at (x, y); 0 outside the image */
int cell_at(const Layout *layout, global const uchar *cells, int x, int y)
{
    const int in = x >= 0 && y >= 0 && x < layout->width - 1 && y < layout->height - 1;
    return in ? cells[(size_t)y * layout->pitch + x] : 0;
}

/* Is the line from the sample (x, y) to its neighbour at offset (dx, dy), each -1 or 1, the diagonal of a cell? */
#define IS_DIAGONAL(x, y, dx, dy) (((dx) == (dy)) == !((min(x, (x) + (dx)) ^ min(y, (y) + (dy))) & 1))

/* Does a drawn triangle have the edge from the sample (x, y) to its neighbour at offset (dx, dy), each -1, 0 or 1? */
int is_edge_drawn(const Layout *layout, global const uchar *cells, int x, int y, int dx, int dy)
{
    const int left = min(x, x + dx), top = min(y, y + dy), byte = cell_at(layout, cells, left, top);
    int states;
    if (dx && dy) {
        states = IS_DIAGONAL(x, y, dx, dy) ? STATE_A(byte) | STATE_B(byte) : 0;
    } else if (dx) {
        states = STATE_A(byte) | STATE_B(cell_at(layout, cells, left, top - 1));
    } else {
        const int before = cell_at(layout, cells, left - 1, top);
        states = (left ^ top) & 1 ? STATE_A(byte) | STATE_A(before) : STATE_B(byte) | STATE_B(before);
    }
    return (states & DRAWN) != 0;
}

/* Direction inwards from an outermost sample along an axis of `count` samples: 1 or -1, 0 at inner samples */
#define INWARDS(x, count) ((x) == 0 ? 1 : (x) == (count) - 1 ? -1 : 0)

/* Limits the nearness half a pixel beyond a sample to 0.5 to 1.5 times the sample's, so depths stay positive. */
float limited(float beyond, float sample)
{
    const float least = (1.0f - BORDER) * sample, most = (1.0f + BORDER) * sample;
    return clamp(beyond, fmin(least, most), fmax(least, most));
}

/* Nearness half a pixel beyond an outermost sample: on the line from the next sample inside, if a drawn triangle has
 * the edge between the two; else the sample's own */
INLINED float nearness_beyond(const Layout *layout, global const float *nearness, global const uchar *cells, int x, int y)
{
    const int dx = INWARDS(x, layout->width), dy = INWARDS(y, layout->height);
    global const float *here = nearness + (size_t)y * layout->pitch + x;
    if (!is_edge_drawn(layout, cells, x, y, dx, dy))
        return *here;
    return limited(*here + BORDER * (*here - here[dy * layout->pitch + dx]), *here);
}

/* Nearness of the vertex beyond an image corner where no diagonal ends: the plane of the corner's only triangle passes
 * through the corner's sample */
static float nearness_beyond_corner(const Layout *layout, global const float *nearness, global const uchar *cells, int x,
                             int y)
{
    const int dx = INWARDS(x, layout->width), dy = INWARDS(y, layout->height);
    const float n = nearness[(size_t)y * layout->pitch + x];
    if (!is_edge_drawn(layout, cells, x, y, dx, 0))
        return n;
    /* Half a pixel, as a fraction of the triangle's legs: a leg is one cell long, plus half a pixel at each border */
    const float share_x = BORDER / (1.0f + BORDER * (layout->width == 2 ? 2 : 1));
    const float share_y = BORDER / (1.0f + BORDER * (layout->height == 2 ? 2 : 1));
    const float next_x = nearness_beyond(layout, nearness, cells, x + dx, y);
    const float next_y = nearness_beyond(layout, nearness, cells, x, y + dy);
    return limited((n - share_x * next_x - share_y * next_y) / (1.0f - share_x - share_y), n);
}

kernel void place_border(global const float *nearness, global const uchar *cells, global float *placed, Layout layout)
{
    const int y = get_global_id(0), width = layout.width;
    if (y >= layout.height)
        return;
    global const float *from = nearness + (size_t)y * layout.pitch;
    global float *to = placed + (size_t)y * layout.pitch;
    for (int first = 0; first < width; first += LANES)
        store_lanes(load_lanes(from + first), to + first);
    const int dy = INWARDS(y, layout.height);
    for (int x = 0; x < width; x += dy ? 1 : width - 1) {
        const int dx = INWARDS(x, width), cut_off = dx && dy && !IS_DIAGONAL(x, y, dx, dy);
        to[x] = cut_off ? nearness_beyond_corner(&layout, nearness, cells, x, y)
                        : nearness_beyond(&layout, nearness, cells, x, y);
    }
}

void add_step(Vector a, Vector b, intl joined, Vector *sum)
{
    sum->x += select_lanes(joined, b.x - a.x, (floatl)0.0f);
    sum->y += select_lanes(joined, b.y - a.y, (floatl)0.0f);
    sum->z += select_lanes(joined, b.z - a.z, (floatl)0.0f);
}

kernel void find_normals(global const float *nearness, global const uchar *cells, global float *normals, Layout layout)
{
    const int y = get_global_id(0);
    if (y >= layout.height)
        return;
    const size_t plane = (size_t)layout.pitch * layout.height;
    global const float *own = nearness + (size_t)y * layout.pitch;
    global const float *above = y > 0 ? own - layout.pitch : own,
                       *below = y < layout.height - 1 ? own + layout.pitch : own;
    for (int first = 0; first < layout.width; first += LANES) {
        const intl x = first + lane_index;
        const floatl n = load_lanes(own + first), right = load_lanes(own + first + 1);
        const floatl left = first ? load_lanes(own + first - 1) : shifted_lanes(n);
        const floatl up = load_lanes(above + first), down = load_lanes(below + first);
        const floatl fx = to_floatl(x), fy = (floatl)y;
        const Vector p = point_of(&layout, fx, fy, DEPTH_OF(layout.perspective, n));
        const Vector to_left = point_of(&layout, fx - 1.0f, fy, DEPTH_OF(layout.perspective, left));
        const Vector to_right = point_of(&layout, fx + 1.0f, fy, DEPTH_OF(layout.perspective, right));
        const Vector to_up = point_of(&layout, fx, fy - 1.0f, DEPTH_OF(layout.perspective, up));
        const Vector to_down = point_of(&layout, fx, fy + 1.0f, DEPTH_OF(layout.perspective, down));
        const intl upper_left = cell_next_to(&layout, cells, x, first, y, -1, -1);
        const intl upper_right = cell_next_to(&layout, cells, x, first, y, 0, -1);
        const intl lower_left = cell_next_to(&layout, cells, x, first, y, -1, 0);
        const intl lower_right = cell_next_to(&layout, cells, x, first, y, 0, 0), main = ((x ^ y) & 1) == 0;
        /* Diagonals alternate from cell to cell, and with them the triangles that have an edge along y at the
         * sample. */
        const intl above = select_lanes(main, STATE_A(upper_left) | STATE_A(upper_right),
                                        STATE_B(upper_left) | STATE_B(upper_right));
        const intl beneath = select_lanes(main, STATE_B(lower_left) | STATE_B(lower_right),
                                          STATE_A(lower_left) | STATE_A(lower_right));
        const intl before = STATE_B(upper_left) | STATE_A(lower_left),
                   after = STATE_B(upper_right) | STATE_A(lower_right);
        Vector across = {0.0f, 0.0f, 0.0f}, along = across;
        add_step(to_left, p, (before & DRAWN) != 0, &across);
        add_step(p, to_right, (after & DRAWN) != 0, &across);
        add_step(to_up, p, (above & DRAWN) != 0, &along);
        add_step(p, to_down, (beneath & DRAWN) != 0, &along);
        /* Without a triangle, the surface is assumed to face the camera. */
        across.x = select_lanes(((before | after) & DRAWN) != 0, across.x, (floatl)1.0f);
        along.y = select_lanes(((above | beneath) & DRAWN) != 0, along.y, (floatl)1.0f);
        const Vector normal = cross_product(along, across); /* towards the camera */
        const floatl length = sqrt(DOT(normal, normal));
        const intl known = length > 0.0f;
        const floatl scale = 1.0f / select_lanes(known, length, (floatl)1.0f);
        global float *out = normals + (size_t)y * layout.pitch + first;
        store_lanes(select_lanes(known, normal.x * scale, (floatl)0.0f), out);
        store_lanes(select_lanes(known, normal.y * scale, (floatl)0.0f), out + plane);
        store_lanes(select_lanes(known, normal.z * scale, (floatl)-1.0f), out + 2 * plane);
    }
}
