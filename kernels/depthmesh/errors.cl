/* The quadtree's errors and bounding spheres, fine to coarse (Pajarola, Sainz & Meng 2003, sections 3.2 and 3.3).
 *
 * A vertex's own error is its distance from the edge that it bisects. For a midpoint, the distance is measured in the
 * plane along the edge and the z axis (equation 1); for a centre, in space (equation 2). A vertex's sphere contains its
 * children's spheres; at the finest step, it contains the triangles that the vertex splits. Errors and spheres grow
 * from children to parents, so independent tests of vertices yield a triangulation without cracks (Lindstrom &
 * Pascucci 2001).
 *
 * Deviations from the paper: a vertex's error bounds the distance between the surfaces with and without the vertex and
 * all that follow from it. Leaving out a vertex moves the points of its triangles by at most its own error, times their
 * barycentric weight of the vertex. A vertex and its child are corners of one triangle, in which their weights add up
 * to at most 1: of both own errors, only the larger one counts. The errors of farther descendants are added, either to
 * the vertex's own error or to this larger one; the lesser sum is the bound. With `largest`, the largest own error
 * counts, as in the paper. A partly drawn triangle is left out unless it is split, so its error is CUT_ERROR times its
 * longest side: at any useful tolerance, the mesh keeps its depth edges.
 *
 * nearness, placed: (height, pitch), samples.cl; nearness is denoised (smooth.cl). For each vertex, (side + 1, row):
 * states, states.cl; errors: scene units, -1 where nothing is drawn; below: the largest error of the children; sums:
 * `below` and the own error; both are 0 where nothing is drawn; radii: the bounding spheres' radii, scene units;
 * depths: the depths of their centres, or a child's depth if the centre has no sample. The spheres contain the drawn
 * triangles. Work-item: `find_finest_midpoints`, `find_finest_centers`: a row of midpoints, or centres, of step 1; the
 * former kernel also initialises vertices without cells. `find_errors`: a row of a coarser step. `find_coarse_errors`:
 * all rows of all coarser steps. Cost: O(vertices). Determinism: maxima of children in a fixed order.
 */
#include "depthmesh/tree.h"

#define ERRORS_PARAMETERS                                                                                      \
    global const float *nearness, global const float *placed, global const uchar *states,                     \
        global float *errors, global float *radii, global float *depths, global float *below, global float *sums,   \
        Layout layout, int largest
#define TREE_VALUE {nearness, placed, states, errors, radii, depths, below, sums, largest}
#define CUT_ERROR 4.0f
#define UNSEEN 0.75f /* standard deviations of the noise: after denoising (smooth.cl), smaller errors count as noise */
#define MARGIN 0.01f /* samples by which a sphere extends beyond its children's: more than rounding errors */

typedef struct {
    global const float *nearness, *placed;
    global const uchar *states;
    global float *errors, *radii, *depths, *below, *sums;
    int largest; /* 1: a vertex's error is the larger of its own and its children's, as in the paper; 0: a bound */
} Tree;

/* Vertices of the tree, and the largest `below` and `sums` of their children */
typedef struct {
    Vector center;
    floatl error, radius, depth, below, sum, child_below, child_sum;
} Vertices;

/* Vertices without triangles, at samples of nearness n */
Vertices no_vertices(const Layout *layout, floatl n)
{
    const Vertices v = {.error = -1.0f,
                        .depth = select_lanes(IS_SAMPLE(n), DEPTH_OF(layout->perspective, n), (floatl)0.0f)};
    return v;
}

/* The column and row of a vertex's sample: vertices of the padding lie on the last column or row. */
#define ON_COLUMN(layout, x) min(x, (intl)((layout)->width - 1))
#define ON_ROW(layout, y) min(y, (intl)((layout)->height - 1))

floatl vertex_nearness(const Layout *layout, const Tree *tree, intl x, intl y)
{
    const intl in = (x < layout->width) & (y < layout->height), at = select_lanes(in, y * layout->pitch + x, (intl)0);
    return select_lanes(in, (floatl)(gather(tree->nearness, at)), (floatl)NO_SURFACE);
}

/* The drawn vertex of sample (x, y) at a nearness, in the frame of the view's camera */
Vector drawn_point(const Layout *layout, intl x, intl y, floatl n)
{
    const floatl u = to_floatl(x) + beyond_sample(x, layout->width);
    const floatl v = to_floatl(y) + beyond_sample(y, layout->height);
    return point_of(layout, u, v, DEPTH_OF(layout->perspective, n));
}

typedef struct {
    intl at; /* index; 0 for no child */
    floatl x, y, error, depth;
} Children;

/* Loads the children at (x, y). Updates the parents v: the largest errors of their children, and missing depths. */
Children add_children(const Layout *layout, const Tree *tree, intl x, intl y, intl there, Vertices *v)
{
    Children c;
    c.at = select_lanes(there, y * layout->row + x, (intl)0);
    c.x = to_floatl(ON_COLUMN(layout, x));
    c.y = to_floatl(ON_ROW(layout, y));
    c.error = select_lanes(there, (floatl)(gather(tree->errors, c.at)), (floatl)-1.0f);
    c.depth = (floatl)(gather(tree->depths, c.at));
    v->error = max_lanes(c.error, v->error);
    v->child_below = fmax(select_lanes(there, (floatl)(gather(tree->below, c.at)), (floatl)0.0f), v->child_below);
    v->child_sum = fmax(select_lanes(there, (floatl)(gather(tree->sums, c.at)), (floatl)0.0f), v->child_sum);
    v->depth = select_lanes((v->depth == 0.0f) & (c.error >= 0.0f), c.depth, v->depth);
    return c;
}

/* Distance between neighbouring samples at a depth, in scene units */
floatl sample_size(const Layout *layout, floatl depth)
{
    return layout->footprint * (layout->perspective ? depth : (floatl)1.0f);
}

INLINED void hold_children(const Layout *layout, const Tree *tree, const Children *c, Vertices *v)
{
    const Vector away = minus(point_of(layout, c->x, c->y, c->depth), v->center);
    const floatl reach = sqrt(DOT(away, away)) + (floatl)(gather(tree->radii, c->at)) +
                         MARGIN * sample_size(layout, v->depth);
    v->radius = select_lanes((c->error >= 0.0f) & (reach > v->radius), reach, v->radius);
}

/* Own errors of the vertices p of samples (x, y), which bisect the edges from a to b; 0 if a, b or p has no sample */
INLINED floatl bisection_error(const Layout *layout, intl x, intl y, floatl n, intl ax, intl ay, floatl na, intl bx,
                               intl by, floatl nb, int centers, int across)
{
    const Vector p = drawn_point(layout, x, y, n);
    const Vector a = drawn_point(layout, ax, ay, na), b = drawn_point(layout, bx, by, nb);
    const Vector ab = minus(b, a), ap = minus(p, a);
    floatl area, length;
    if (centers) {
        const Vector normal = cross_product(ab, ap);
        area = sqrt(DOT(normal, normal));
        length = sqrt(DOT(ab, ab));
    } else {
        const floatl run = across ? ab.x : ab.y, to_p = across ? ap.x : ap.y;
        area = fabs(run * ap.z - ab.z * to_p);
        length = sqrt(run * run + ab.z * ab.z);
    }
    const intl known = IS_SAMPLE(n) & IS_SAMPLE(na) & IS_SAMPLE(nb) & (length > 0.0f);
    const floatl off = area / select_lanes(known, length, (floatl)1.0f);
    return select_lanes(known & (off > ROUNDING * (fabs(a.z) + fabs(b.z) + fabs(p.z))), off, (floatl)0.0f);
}

/* Own errors of the centres p of blocks from column `left` to `right` and row `top` to `bottom`. corner: nearness of
 * the corners, row by row. In a block of step s at the border, p may not lie on the diagonal in the image. There the
 * error is the larger distance from p to the planes of the two triangles at the diagonal; a plane with a corner without
 * sample does not count. This is a bound, as surfaces with and without p differ most at p. */
floatl center_error(const Layout *layout, intl x, intl y, int s, floatl n, intl left, intl right, intl top, intl bottom,
                    const floatl corner[4])
{
    const intl at_border = (x <= s) | (y <= s) | (x + s >= layout->width - 1) | (y + s >= layout->height - 1);
    const intl main = IS_MAIN(x, y, s), on_x = ON_COLUMN(layout, x), on_y = ON_ROW(layout, y);
    const intl ay = select_lanes(main, top, bottom), by = select_lanes(main, bottom, top);
    const floatl na = select_lanes(main, corner[0], corner[2]), nb = select_lanes(main, corner[3], corner[1]);
    const floatl bisected = bisection_error(layout, on_x, on_y, n, left, ay, na, right, by, nb, 1, 0);
    if (!any_lane(at_border))
        return bisected;
    const Vector p = drawn_point(layout, on_x, on_y, n);
    const Vector a = drawn_point(layout, left, ay, na), b = drawn_point(layout, right, by, nb);
    const Vector ab = minus(b, a), ap = minus(p, a);
    const floatl rounding = 2.0f * ROUNDING * (fabs(a.z) + fabs(b.z) + fabs(p.z)); /* 2: p may lie beyond the ends */
    floatl error = 0.0f;
    for (int k = 0; k < 2; k++) {
        const floatl nc = k ? select_lanes(main, corner[1], corner[3]) : select_lanes(main, corner[2], corner[0]);
        const Vector normal = cross_product(ab, minus(drawn_point(layout, k ? right : left, k ? ay : by, nc), a));
        const floatl off = fabs(DOT(ap, normal)) / fmax(sqrt(DOT(normal, normal)), (floatl)FLT_MIN);
        const intl known = IS_SAMPLE(n) & IS_SAMPLE(na) & IS_SAMPLE(nb) & IS_SAMPLE(nc) & (off > rounding);
        error = fmax(error, select_lanes(known, off, (floatl)0.0f));
    }
    return select_lanes(at_border, error, bisected);
}

/* Sets the vertices' errors from the children's errors, whose largest is v->error, and from the part of their own
 * errors that noise does not explain. Where nothing is drawn, errors stay -1. */
void add_error(const Layout *layout, const Tree *tree, floatl own, intl states, int s, int centers, Vertices *v)
{
    const intl a = STATE_A(states), b = STATE_B(states);
    const intl partly = (a == (UNDRAWN | DRAWN)) | (b == (UNDRAWN | DRAWN)), drawn = ((a | b) & DRAWN) != 0;
    const float samples = CUT_ERROR * 2.0f * s * (centers ? M_SQRT2_F : 1.0f);
    const floatl length = samples * sample_size(layout, v->depth);
    own = select_lanes(drawn, fmax(own - UNSEEN * NOISE_AT(layout->noise, v->depth), (floatl)0.0f), (floatl)0.0f);
    v->below = fmax(v->error, (floatl)0.0f);
    v->sum = own + v->below;
    const floatl in_pairs = fmax(own + v->child_below, v->child_sum);
    const floatl bound = tree->largest ? own : fmin(v->sum, in_pairs);
    const floatl joined = fmax(fmax(v->below, bound), select_lanes(partly, length, (floatl)0.0f));
    v->error = select_lanes(drawn, joined, v->error);
}

/* Finds errors and spheres of row y of the vertices of step s > 1. */
INLINED void find_error_row(const Layout *layout, const Tree *tree, int s, int y, int centers)
{
    const int across = !(y / s & 1); /* are the midpoints of this row on edges along x? */
    for (int start = centers || across ? s : 0; start <= layout->side && start - s < layout->width - 1;
         start += 2 * s * LANES) {
        const intl x = start + 2 * s * lane_index, mine = (x <= layout->side) & (x - s < layout->width - 1);
        const intl row = (intl)y, at = select_lanes(mine, row * layout->row + x, (intl)0);
        const intl sample_x = ON_COLUMN(layout, x), sample_y = ON_ROW(layout, row);
        const floatl n = vertex_nearness(layout, tree, sample_x, sample_y);
        Vertices v = no_vertices(layout, n);
        Children children[4]; /* above, right, below, left of a centre; diagonally from a midpoint */
        for (int k = 0; k < 4; k++) {
            const int dx = centers ? (k == 1 ? s : k == 3 ? -s : 0) : (k & 1 ? s / 2 : -s / 2);
            const int dy = centers ? (k == 2 ? s : k == 0 ? -s : 0) : (k >> 1 ? s / 2 : -s / 2);
            const intl there = mine & (x + dx >= 0) & (x + dx <= layout->side) & (row + dy >= 0) &
                               (row + dy <= layout->side);
            children[k] = add_children(layout, tree, x + dx, row + dy, there, &v);
        }
        v.center = point_of(layout, to_floatl(sample_x), to_floatl(sample_y), v.depth);
        for (int k = 0; k < 4; k++)
            hold_children(layout, tree, &children[k], &v);
        const int before_x = centers || across ? s : 0, before_y = centers || !across ? s : 0;
        const intl left = ON_COLUMN(layout, x - before_x), right = ON_COLUMN(layout, x + before_x);
        const intl top = ON_ROW(layout, row - before_y), bottom = ON_ROW(layout, row + before_y);
        const floatl na = vertex_nearness(layout, tree, left, top), nb = vertex_nearness(layout, tree, right, bottom);
        floatl own;
        if (centers) {
            const floatl corner[4] = {na, vertex_nearness(layout, tree, right, top),
                                      vertex_nearness(layout, tree, left, bottom), nb};
            own = center_error(layout, x, row, s, n, left, right, top, bottom, corner);
        } else
            own = bisection_error(layout, sample_x, sample_y, n, left, top, na, right, bottom, nb, 0, across);
        const intl states = (intl)(gather(tree->states, at));
        add_error(layout, tree, own, states, s, centers, &v);
        for (int lane = 0; lane < LANES; lane++) {
            if (!int_lane(mine, lane))
                continue;
            const int to = int_lane(at, lane);
            tree->errors[to] = float_lane(v.error, lane);
            tree->below[to] = float_lane(v.below, lane);
            tree->sums[to] = float_lane(v.sum, lane);
            tree->radii[to] = float_lane(v.radius, lane);
            tree->depths[to] = float_lane(v.depth, lane);
        }
    }
}

/* Nearness at the offset (dx, dy), each -1, 0 or 1, from the samples x of row y; NO_SURFACE outside the image */
floatl nearness_next_to(const Layout *layout, global const float *nearness, intl x, int first, int y, int dx, int dy)
{
    if (y + dy < 0 || y + dy >= layout->height)
        return NO_SURFACE;
    global const float *row = nearness + (size_t)(y + dy) * layout->pitch;
    const intl in = (x + dx >= 0) & (x + dx < layout->width);
    return select_lanes(in, NEXT_TO(load_lanes, row, first, dx), (floatl)NO_SURFACE);
}

void store_vertices(const Tree *tree, size_t at, const Vertices *v)
{
    store_lanes(v->error, tree->errors + at);
    store_lanes(v->radius, tree->radii + at);
    store_lanes(v->depth, tree->depths + at);
    store_lanes(v->below, tree->below + at);
    store_lanes(v->sum, tree->sums + at);
}

kernel void find_finest_midpoints(ERRORS_PARAMETERS)
{
    const int y = get_global_id(0), across = !(y & 1);
    if (y > layout.side)
        return;
    const Tree tree = TREE_VALUE;
    for (int first = 0; first <= layout.side; first += LANES) {
        const size_t at = (size_t)y * layout.row + first;
        const intl x = first + lane_index, ax = x - across, bx = x + across;
        const int ay = y - !across, by = y + !across;
        Vertices v = no_vertices(&layout, (floatl)NO_SURFACE);
        if (first < layout.width && y < layout.height) {
            const floatl n = nearness_next_to(&layout, nearness, x, first, y, 0, 0);
            const floatl na = nearness_next_to(&layout, nearness, x, first, y, across ? -1 : 0, across ? 0 : -1);
            const floatl nb = nearness_next_to(&layout, nearness, x, first, y, across ? 1 : 0, across ? 0 : 1);
            v.depth = no_vertices(&layout, n).depth;
            v.center = point_of(&layout, to_floatl(x), (floatl)y, v.depth);
            const floatl own = bisection_error(&layout, x, (intl)y, n, ax, (intl)ay, na, bx, (intl)by, nb, 0, across);
            for (int k = 0; k < 5; k++) { /* the vertex, and corners of triangles that it splits */
                const int dx = k == 0 ? -1 : k == 1, dy = k == 2 ? -1 : k == 3;
                const floatl next = nearness_next_to(&layout, placed, x, first, y, dx, dy);
                const floatl to_x = to_floatl(x + dx) + beyond_sample(x + dx, layout.width);
                const floatl to_y = place_of(y + dy, layout.height);
                const Vector p = point_of(&layout, to_x, to_y, DEPTH_OF(layout.perspective, next));
                const Vector away = minus(p, v.center);
                v.radius = select_lanes(IS_SAMPLE(next), max_lanes(sqrt(DOT(away, away)), v.radius), v.radius);
            }
            const intl odd = (x & 1) == 1, mine = layout.side == 1 ? (intl)0 : across ? odd : !odd;
            add_error(&layout, &tree, own, select_lanes(mine, load_bytes(states + at), (intl)0), 1, 0, &v);
        }
        store_vertices(&tree, at, &v);
    }
}

kernel void find_finest_centers(ERRORS_PARAMETERS)
{
    const int y = 2 * get_global_id(0) + 1;
    if (y > layout.side || y >= layout.height)
        return;
    const Tree tree = TREE_VALUE;
    const int dx[4] = {0, 1, 0, -1}, dy[4] = {-1, 0, 1, 0}; /* children above, right, below, left */
    for (int first = 0; first < layout.width; first += LANES) {
        const size_t at = (size_t)y * layout.row + first;
        const intl x = first + lane_index, mine = ((x & 1) == 1) & (x < layout.width);
        const floatl n = nearness_next_to(&layout, nearness, x, first, y, 0, 0);
        Vertices v = no_vertices(&layout, n);
        floatl error[4], depth[4], radius[4];
        for (int k = 0; k < 4; k++) {
            const size_t start = (size_t)(y + dy[k]) * layout.row;
            error[k] = NEXT_TO(load_lanes, errors + start, first, dx[k]);
            depth[k] = NEXT_TO(load_lanes, depths + start, first, dx[k]);
            radius[k] = NEXT_TO(load_lanes, radii + start, first, dx[k]);
            v.error = max_lanes(error[k], v.error);
            v.depth = select_lanes((v.depth == 0.0f) & (error[k] >= 0.0f), depth[k], v.depth);
        }
        v.child_sum = fmax(v.error, (floatl)0.0f);
        v.center = point_of(&layout, to_floatl(x), (floatl)y, v.depth);
        for (int k = 0; k < 4; k++) {
            const Vector away = minus(point_of(&layout, to_floatl(x + dx[k]), (floatl)(y + dy[k]), depth[k]), v.center);
            const floatl reach = sqrt(DOT(away, away)) + radius[k] + MARGIN * sample_size(&layout, v.depth);
            v.radius = select_lanes(error[k] >= 0.0f, max_lanes(reach, v.radius), v.radius);
        }
        const int down = y < layout.height - 1; /* rows to the row below: 0 in the last row of the image */
        const intl last = x == layout.width - 1;
        floatl corner[4];
        for (int k = 0; k < 4; k++) {
            const int dx = k & 1 ? 1 : -1, dy = k >> 1 ? down : -1;
            const floatl next = nearness_next_to(&layout, nearness, x, first, y, dx, dy);
            const floatl above = nearness_next_to(&layout, nearness, x, first, y, 0, dy);
            corner[k] = dx < 0 ? next : select_lanes(last, above, next);
        }
        const floatl own = center_error(&layout, x, (intl)y, 1, n, x - 1, ON_COLUMN(&layout, x + 1), (intl)(y - 1),
                                        (intl)(y + down), corner);
        add_error(&layout, &tree, own, load_bytes(states + at), 1, 1, &v);
        v.error = select_lanes(mine, v.error, load_lanes(errors + at));
        v.below = select_lanes(mine, v.below, load_lanes(below + at));
        v.sum = select_lanes(mine, v.sum, load_lanes(sums + at));
        v.radius = select_lanes(mine, v.radius, load_lanes(radii + at));
        v.depth = select_lanes(mine, v.depth, load_lanes(depths + at));
        store_vertices(&tree, at, &v);
    }
}

kernel void find_errors(ERRORS_PARAMETERS, int s, int centers)
{
    const int y = centers ? s + 2 * s * (int)get_global_id(0) : s * (int)get_global_id(0);
    if (y > layout.side || y - s >= layout.height - 1)
        return;
    const Tree tree = TREE_VALUE;
    find_error_row(&layout, &tree, s, y, centers);
}

kernel void find_coarse_errors(ERRORS_PARAMETERS, int finest)
{
    if (get_global_id(0) > 0)
        return;
    const Tree tree = TREE_VALUE;
    for (int s = finest; s < layout.side; s *= 2)
        for (int centers = 0; centers < 2; centers++)
            for (int y = centers ? s : 0; y <= layout.side && y - s < layout.height - 1; y += centers ? 2 * s : s)
                find_error_row(&layout, &tree, s, y, centers);
}
