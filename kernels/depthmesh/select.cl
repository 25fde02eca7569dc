/* From the quadtree to triangles (Pajarola, Sainz & Meng 2003, section 3.4).
 *
 * `activate` marks the vertices that a target needs: vertices whose error, projected from the nearest point of their
 * bounding sphere, exceeds the tolerance (equation 5), if the sphere meets the target's view. A vertex's error and
 * sphere include its children's, so vertices are tested independently, and no cracks arise. A triangle belongs to the
 * triangulation if the vertex at its right angle is active and the vertex that would split it is not. It is drawn if
 * segmentation keeps all of its cells. `find_triangles` finds the drawn triangles and counts the points, `list_points`
 * and `list_triangles` list them.
 *
 * Deviations from the paper: the distance is measured to the sphere, not to the vertex, as the independent tests
 * require. Equation 5 holds on the camera's axis only: at an angle t from it, errors are drawn up to 1 / cos^2 t times
 * as large (`stretch_of`). For a viewer that will move, a finer tolerance and a wider view may select more vertices;
 * `motion_limits` bound the motion for which the selection suffices.
 *
 * placed: samples.cl. For each vertex, (side + 1, row): errors, radii, depths: errors.cl; active: tree.h; drawn: bit k
 * is set if the k-th triangle with its right angle at the vertex is drawn; numbers: index of the vertex's point in
 * `points`. counts: (side + 1, 2) numbers of points and triangles of each row; firsts: (side + 1, 2) indices of each
 * row's first point and triangle. points: (points, 4) a, b, c of tree.h, and quality (the normal's |z|) if `rated`.
 * corners: (triangles, 3) indices of points, counter-clockwise as seen by the view, the second at the right angle.
 * motion_limits: (side + 1, 2) minima over a row's inactive vertices, in scene units: how far the eye may move until a
 * projected error may exceed `allowed`; and the eye's distance from them. Work-item: a row of vertices. Cost:
 * O(vertices). Determinism: the order of rows and columns.
 */
#include "depthmesh/tree.h"

#define POINTS 1024
#define AT_THE_EYE 1e-15f /* scene units: distance to a sphere that contains the eye; > 0, so errors of 0 never count */

typedef struct {
    float eye[3];      /* position of the target's camera in the frame of the view's camera */
    float planes[5][4]; /* planes of the target's view: a x + b y + c z + d >= 0 inside, unit normals */
    float scale;       /* pixels per scene unit: at distance 1 (perspective), everywhere (orthographic) */
    float tolerance;   /* pixels */
    float allowed;     /* pixels, at least the tolerance: the error that `motion_limits` refer to */
    float least_cosine; /* of the angle between the axis and the lines of sight in the picture, at one of its corners */
    float widening;    /* the view's planes are moved outwards by this times the distance from the eye */
    int perspective;
} Viewer;

/* Largest stretch of a picture within spheres around the points p: at an angle t from the axis, distances across the
 * line of sight are drawn up to 1 / cos^2 t times as large as on the axis. */
INLINED floatl stretch_of(const Viewer *viewer, Vector p, floatl from_eye, floatl radius)
{
    if (!viewer->perspective)
        return 1.0f;
    const float *axis = viewer->planes[4];
    const floatl z = axis[0] * p.x + axis[1] * p.y + axis[2] * p.z + axis[3], far = from_eye * from_eye;
    const floatl aside = sqrt(fmax(far - z * z, (floatl)0.0f));
    const floatl before = sqrt(fmax(far - radius * radius, (floatl)0.0f));
    /* 1 / cosine of the sum of t and the sphere's angle */
    const floatl secant = far / fmax(z * before - aside * radius, viewer->least_cosine * far);
    return secant * secant;
}

kernel void activate(global const float *errors, global const float *radii, global const float *depths,
                     global uchar *active, global float *motion_limits, Layout layout, Viewer viewer)
{
    const int y = get_global_id(0);
    if (y > layout.side)
        return;
    const size_t start = (size_t)y * layout.row;
    floatl motion_limit = INFINITY, nearest = INFINITY;
    for (int first = 0; first <= layout.side; first += LANES) {
        const size_t at = start + first;
        const floatl error = load_lanes(errors + at), radius = load_lanes(radii + at);
        const intl x = first + lane_index, known = (error >= 0.0f) & (x <= layout.side);
        intl needed = known;
        if (any_lane(known)) {
            const Vector p = point_of(&layout, to_floatl(min(x, (intl)(layout.width - 1))),
                                      (floatl)min(y, layout.height - 1), load_lanes(depths + at));
            const Vector away = {p.x - viewer.eye[0], p.y - viewer.eye[1], p.z - viewer.eye[2]};
            const floatl from_eye = fmax(sqrt(DOT(away, away)), (floatl)AT_THE_EYE);
            const floatl distance = viewer.perspective ? fmax(from_eye - radius, (floatl)AT_THE_EYE) : (floatl)1.0f;
            /* With this margin, too, children's spheres lie within their parent's. */
            const floatl margin = radius + viewer.widening * (from_eye + radius);
            const floatl pixels = error * viewer.scale * stretch_of(&viewer, p, from_eye, margin);
            const intl large = known & (pixels >= viewer.tolerance * distance);
            needed = large;
            for (int k = 0; k < 5 && any_lane(needed); k++) {
                const float *plane = viewer.planes[k];
                needed = needed & (plane[0] * p.x + plane[1] * p.y + plane[2] * p.z + plane[3] >= -margin);
            }
            motion_limit = fmin(
                motion_limit,
                select_lanes(known & (!large), distance - pixels * (1.0f / viewer.allowed), (floatl)INFINITY));
            nearest = fmin(nearest, select_lanes(known & (!needed), from_eye, (floatl)INFINITY));
        }
        store_bytes(to_ucharl(select_lanes(needed, (intl)ACTIVE, (intl)0)), active + at);
    }
    vstore2((float2)(least_lane(motion_limit), least_lane(nearest)), y, motion_limits);
    mark_corners(&layout, active, y);
}

/* Column of the first marked vertex in a row, from column x on; greater than `side` if there is none */
int next_marked(global const uchar *row, int x, int side)
{
    for (; x <= side; x++) {
        while (!(x & 7) && x <= side && !*(global const ulong *)(row + x)) /* rows are multiples of 8 bytes */
            x += 8;
        if (x <= side && row[x])
            break;
    }
    return x;
}

/* Is side b (0: A, 1: B) of the vertex `at` not split, and are all cells of this side drawn? */
#define IS_DRAWN(at, b) (!IS_ACTIVE(active[at]) & (((b) ? STATE_B(states[at]) : STATE_A(states[at])) == DRAWN))

/* The drawn triangles with their right angle at the vertex (x, y): a bit for each place around it, clockwise. Bit 0 is
 * above a centre, or to the upper left of a midpoint. */
int triangles_at(const Layout *layout, global const uchar *active, global const uchar *states,
                 global const uchar *cells, int x, int y)
{
    const int s = step_of(x, y), row = layout->row, at = y * row + x;
    if (IS_CENTER(x, y, s))
        return IS_DRAWN(at - s * row, 1) | IS_DRAWN(at + s, 0) << 1 | IS_DRAWN(at + s * row, 0) << 2 |
               IS_DRAWN(at - s, 1) << 3;
    int found = 0;
    for (int k = 0; k < 4; k++) {
        const int right = k == 1 || k == 2, below = k > 1;
        if (x == (right ? layout->side : 0) || y == (below ? layout->side : 0))
            continue;
        if (s > 1) {
            const int split = at + (right ? s / 2 : -s / 2) + (below ? s / 2 : -s / 2) * row;
            found |= IS_DRAWN(split, !below) << k;
            continue;
        }
        const int cell_x = x - !right, cell_y = y - !below;
        if (cell_x >= layout->width - 1 || cell_y >= layout->height - 1)
            continue;
        const int byte = cells[cell_y * layout->pitch + cell_x];
        found |= ((below ? STATE_A(byte) : STATE_B(byte)) == DRAWN) << k;
    }
    return found;
}

/* Marks as LISTED the border samples on which active vertices of the padding lie. Work-item: the vertices of a row and
 * of a column. */
kernel void list_border(global uchar *active, Layout layout)
{
    const int at = get_global_id(0), right = layout.width - 1, bottom = layout.height - 1;
    if (at > layout.side)
        return;
    for (int s = 1; s <= layout.side && !(at & (s - 1)); s *= 2) {
        /* For each step, only the first vertex beyond the border: triangles of farther vertices have no area. */
        const int x = (right + s - 1) & -s, y = (bottom + s - 1) & -s;
        if (active[at * layout.row + x])
            active[min(at, bottom) * layout.row + right] |= LISTED;
        if (active[y * layout.row + at])
            active[bottom * layout.row + min(at, right)] |= LISTED;
    }
}

kernel void find_triangles(global const uchar *active, global const uchar *states, global const uchar *cells,
                           global uchar *drawn, global int *counts, Layout layout)
{
    const int y = get_global_id(0);
    if (y > layout.side)
        return;
    int points = 0, triangles = 0;
    const size_t start = (size_t)y * layout.row;
    for (int x = -1; (x = next_marked(active + start, x + 1, layout.side)) <= layout.side;) {
        points += x < layout.width && y < layout.height;
        if (!IS_ACTIVE(active[start + x]))
            continue;
        const int found = triangles_at(&layout, active, states, cells, x, y);
        drawn[start + x] = found;
        triangles += popcount(found);
    }
    counts[2 * y] = points;
    counts[2 * y + 1] = triangles;
}

kernel void list_points(global const uchar *active, global const float *placed, global const int *firsts,
                        global int *numbers, global float *points, Layout layout,
                        global const float *normals /* not read unless rated */, int rated)
{
    const int y = get_global_id(0);
    if (y >= layout.height)
        return;
    const size_t start = (size_t)y * layout.row, samples = (size_t)y * layout.pitch;
    global const float *facing = normals + (rated ? (size_t)2 * layout.pitch * layout.height + samples : 0);
    int number = firsts[2 * y];
    for (int x = -1; (x = next_marked(active + start, x + 1, layout.width - 1)) < layout.width; number++) {
        const float n = placed[samples + x], z = 1.0f / n, quality = rated ? fabs(facing[x]) : 0.0f;
        const float u = place_of(x, layout.width), v = place_of(y, layout.height);
        numbers[start + x] = number;
        vstore4(layout.perspective ? (float4)(u * z, v * z, z, quality) : (float4)(u, v, n, quality), number, points);
    }
}

kernel void list_triangles(global const uchar *active, global const uchar *drawn, global const int *numbers,
                           global const int *firsts, global int *corners, Layout layout)
{
    const int y = get_global_id(0), row = layout.row;
    if (y > layout.side)
        return;
    const size_t start = (size_t)y * row;
    global int *next = corners + 3 * (size_t)firsts[2 * y + 1];
    for (int x = -1; (x = next_marked(active + start, x + 1, layout.side)) <= layout.side;) {
        if (!IS_ACTIVE(active[start + x]) || !drawn[start + x])
            continue;
        const int s = step_of(x, y), last_x = layout.width - 1, last_y = layout.height - 1;
        const int left = min(x - s, last_x), on_x = min(x, last_x), right = min(x + s, last_x);
        const int top = min(y - s, last_y) * row, on_y = min(y, last_y) * row, bottom = min(y + s, last_y) * row;
        const int around[2][5] = {{on_y + left, top + on_x, on_y + right, bottom + on_x, on_y + left},
                                  {top + left, top + right, bottom + right, bottom + left, top + left}};
        const int *corner = around[IS_CENTER(x, y, s)], middle = on_y + on_x;
        for (int k = 0; k < 4; k++) {
            if (!(drawn[start + x] >> k & 1))
                continue;
            /* Rounding may leave a corner unlisted: the right angle replaces it, and the triangle has no area. */
            next[0] = numbers[active[corner[k]] ? corner[k] : middle];
            next[1] = numbers[middle];
            next[2] = numbers[active[corner[k + 1]] ? corner[k + 1] : middle];
            next += 3;
        }
    }
}

/* Projects the points of several meshes into the target's pixel space. firsts: (meshes + 1,) index of each mesh's
 * first point. maps: (meshes, 16) matrices for (a, b, c, 1). projected: (points, 4). Work-item: POINTS points. */
kernel void project_points(global const float *points, global const int *firsts, global const float *maps, int meshes,
                           global float *projected)
{
    const int start = get_global_id(0) * POINTS;
    for (int mesh = 0; mesh < meshes; mesh++) {
        global const float *m = maps + 16 * mesh;
        const float4 a = (float4)(m[0], m[4], m[8], m[12]), b = (float4)(m[1], m[5], m[9], m[13]);
        const float4 c = (float4)(m[2], m[6], m[10], m[14]), d = (float4)(m[3], m[7], m[11], m[15]);
        for (int i = max(start, firsts[mesh]); i < min(start + POINTS, firsts[mesh + 1]); i++) {
            const float4 p = vload4(i, points);
            vstore4(a * p.x + b * p.y + c * p.z + d, i, projected);
        }
    }
}
