/* Triangulation of a depth image with a bound on the error in depth, independent of the viewer.
 *
 * Starting from the coarsest triangles, each triangle is split if its depth is wrong by more than max_error at any
 * sample within it. All samples are tested, not only the vertex that would split the triangle, so max_error is a bound.
 * To avoid cracks, a split may force splits of other triangles. Every triangulation of the tree within the bound needs
 * each of these splits, so no such triangulation has fewer triangles. Planes are affine in nearness, so nearness is
 * compared, for both projections.
 *
 * nearness, placed: (height, pitch), samples.cl. states: states.cl. active: (side + 1, row), tree.h, filled with 0 by
 * the caller. pool: chunks of CHUNK ints; each work-item builds a stack of vertices from chunks. A chunk holds the
 * indices of the chunks below and above it, then vertices. used: (1,) number of used chunks. coarse: a step (tree.h).
 * Work-item: `refine_coarse`: all vertices with steps of at least `coarse`; then `refine`: one of these vertices, and
 * all vertices that follow from it and that no other work-item has taken. A work-item may see marks of other work-items
 * late or never, so an atomic operation decides which work-item takes a vertex. Cost: O(triangles + samples): most
 * triangles that must be split are recognised at the first samples; other triangles are read in rows, LANES samples at
 * a time. Determinism: whether a triangle is split does not depend on the order of the tests.
 */
#include "depthmesh/tree.h"

#ifndef CHUNK
#define CHUNK 64 /* ints in a chunk of the pool */
#endif

#define NO_CHUNK -1
#define ON_EDGE 1e-3f /* samples: within this distance, a sample outside a triangle counts as on its edge */

/* An edge of a triangle, from row `low` to row `high`: it crosses row y at the column x + (y - low) * slope. */
typedef struct {
    float x, slope, low, high;
} RowEdge;

/* A drawn triangle. Its corners are the start of the longest side, the right angle and the end of the longest side:
 * `corner` holds their samples, `at` their drawn positions (half a pixel farther out at the border), `n` their
 * nearness. Its plane has the nearness n[1] + (x - at[1].x) * per_x + (y - at[1].y) * per_y. */
typedef struct {
    int2 corner[3], low, high; /* low, high: least and greatest coordinates of the corners */
    float2 at[3];
    float n[3], per_x, per_y;
    RowEdge edges[3];
} Within;

RowEdge row_edge(float2 a, float2 b)
{
    const float2 upper = a.y < b.y ? a : b, lower = a.y < b.y ? b : a;
    const RowEdge edge = {upper.x, (lower.x - upper.x) / (lower.y - upper.y), upper.y,
                          upper.y == lower.y ? -INFINITY : lower.y};
    return edge;
}

/* Widens `part`, the first and last column of a row in a triangle, to the column where the row crosses an edge. */
void widen_to_edge(RowEdge edge, float row, float2 *part)
{
    if (row < edge.low || row > edge.high)
        return;
    const float x = edge.x + (row - edge.low) * edge.slope;
    part->x = fmin(part->x, x);
    part->y = fmax(part->y, x);
}

/* The sample on which a vertex lies */
int2 sample_of(const Layout *layout, int2 v)
{
    return min(v, (int2)(layout->width - 1, layout->height - 1));
}

/* Sets t to the triangle on side b (0: A, 1: B) of the vertex (x, y) of step s. Returns whether its area is not 0. */
int triangle_within(const Layout *layout, global const float *placed, int x, int y, int s, int b, Within *t)
{
    const int centers = IS_CENTER(x, y, s), across = (x & s) != 0, rises = centers && !IS_MAIN(x, y, s);
    const int2 p = (int2)(x, y), along = centers ? (int2)(s, rises ? -s : s) : across ? (int2)(s, 0) : (int2)(0, s);
    const int2 to_a = centers ? (int2)(rises ? -s : s, -s) : across ? (int2)(0, -s) : (int2)(-s, 0);
    const int2 corner[3] = {p - along, b ? p - to_a : p + to_a, p + along};
    if (any(corner[1] < 0) || any(corner[1] > layout->side))
        return 0;
    for (int k = 0; k < 3; k++) {
        const int2 v = sample_of(layout, corner[k]);
        t->corner[k] = v;
        t->at[k] = (float2)(place_of(v.x, layout->width), place_of(v.y, layout->height));
        t->n[k] = placed[v.y * layout->pitch + v.x];
    }
    t->low = min(t->corner[1], min(t->corner[0], t->corner[2]));
    t->high = max(t->corner[1], max(t->corner[0], t->corner[2]));
    const float2 u = t->at[0] - t->at[1], v = t->at[2] - t->at[1];
    const float area = u.x * v.y - u.y * v.x, inverse = 1.0f / area;
    t->per_x = ((t->n[0] - t->n[1]) * v.y - (t->n[2] - t->n[1]) * u.y) * inverse;
    t->per_y = ((t->n[2] - t->n[1]) * u.x - (t->n[0] - t->n[1]) * v.x) * inverse;
    for (int k = 0; k < 3; k++)
        t->edges[k] = row_edge(t->at[k], t->at[(k + 1) % 3]);
    return area != 0.0f;
}

/* First and last column of the triangle's samples in a row; the first exceeds the last if there are none */
int2 columns_within(const Within *t, int row)
{
    float2 part = (float2)(INFINITY, -INFINITY);
    for (int k = 0; k < 3; k++)
        widen_to_edge(t->edges[k], row, &part);
    return (int2)(max((int)ceil(part.x - ON_EDGE), t->low.x), min((int)floor(part.y + ON_EDGE), t->high.x));
}

INLINED floatl plane_nearness(const Within *t, intl x, int row)
{
    return t->n[1] + (row - t->at[1].y) * t->per_y + (to_floatl(x) - t->at[1].x) * t->per_x;
}

typedef struct {
    global const float *nearness, *placed;
    global const uchar *states;
    global uchar *active;
    float max_error;
    int finest; /* least step of children to visit */
    global int *pool, *used;
    int chunk, height; /* top of the stack of active vertices whose parents and children are not visited yet */
} Work;

/* Do a plane of nearness p and a sample of nearness n differ by more than max_error in depth? Without division */
#define IS_OFF(p, n) (fabs((p) - (n)) > work->max_error * (layout->perspective ? fabs((p) * (n)) : 1.0f))
#define NEARNESS_AT(v) work->nearness[(v).y * layout->pitch + (v).x]

/* Must the triangle on the side b (0: A, 1: B) of the vertex (x, y) of step s be split? */
int must_split(const Layout *layout, const Work *work, int x, int y, int s, int b)
{
    const int byte = work->states[y * layout->row + x], state = b ? STATE_B(byte) : STATE_A(byte);
    if (state != DRAWN)
        return state == (UNDRAWN | DRAWN);
    Within t;
    triangle_within(layout, work->placed, x, y, s, b, &t);
    const int is_inner = t.low.x > 0 && t.low.y > 0 && t.high.x < layout->width - 1 && t.high.y < layout->height - 1;
    if (is_inner) {
        /* Check the vertex itself and the middles of the two legs first: there the plane is wrong most often. */
        const int2 start = t.corner[0], q = t.corner[1], end = t.corner[2];
        if (IS_OFF(0.5f * (t.n[0] + t.n[2]), NEARNESS_AT((int2)(x, y))))
            return 1;
        if (s == 1 && !IS_CENTER(x, y, s))
            return 0;
        if (IS_OFF(0.5f * (t.n[0] + t.n[1]), NEARNESS_AT((start + q) / 2)) ||
            IS_OFF(0.5f * (t.n[2] + t.n[1]), NEARNESS_AT((end + q) / 2)))
            return 1;
        if (s == 1)
            return 0;
    }
    for (int row = t.low.y; row <= t.high.y; row++) {
        const int2 columns = columns_within(&t, row);
        for (int first = columns.x; first <= columns.y; first += LANES) {
            const intl at = first + lane_index;
            const floatl plane = plane_nearness(&t, at, row);
            if (any_lane((at <= columns.y) & IS_OFF(plane, load_lanes(work->nearness + row * layout->pitch + first))))
                return 1;
        }
    }
    return 0;
}

#ifdef __ENDIAN_LITTLE__
#define BYTE_IN_WORD(at) (8 * ((at) & 3))
#else
#define BYTE_IN_WORD(at) (24 - 8 * ((at) & 3))
#endif

/* Puts a chunk on top of a stack: a chunk that the stack used before, or a new one. */
void add_chunk(Work *work)
{
    const int below = work->chunk;
    int above = below == NO_CHUNK ? NO_CHUNK : work->pool[CHUNK * below + 1];
    if (above == NO_CHUNK) {
        above = atomic_inc(work->used);
        work->pool[CHUNK * above] = below;
        work->pool[CHUNK * above + 1] = NO_CHUNK;
        if (below != NO_CHUNK)
            work->pool[CHUNK * below + 1] = above;
    }
    work->chunk = above;
    work->height = 2;
}

/* Activates a vertex, unless it is a corner of the tree, lies outside the tree, or is taken by another work-item. */
void activate_vertex(const Layout *layout, Work *work, int x, int y)
{
    const int side = layout->side, at = y * layout->row + x, shift = BYTE_IN_WORD(at);
    if (x < 0 || x > side || y < 0 || y > side || ((x == 0 || x == side) && (y == 0 || y == side)) || work->active[at])
        return;
    if (atomic_or((volatile global int *)work->active + at / 4, ACTIVE << shift) >> shift & ACTIVE)
        return;
    if (work->height == CHUNK)
        add_chunk(work);
    work->pool[CHUNK * work->chunk + work->height++] = at;
}

/* Activates the child (x, y) of step s of an active vertex, if the child's triangle on side b must be split. */
void visit_child(const Layout *layout, Work *work, int x, int y, int s, int b)
{
    const int in = x >= 0 && x <= layout->side && y >= 0 && y <= layout->side;
    if (in && !work->active[y * layout->row + x] && must_split(layout, work, x, y, s, b))
        activate_vertex(layout, work, x, y);
}

/* Activates the vertices that follow from the active vertex `at`: its parents, and, if the children's step is less than
 * `coarse`, the children whose triangles must be split. */
INLINED void propagate(const Layout *layout, Work *work, int at, int coarse)
{
    const int y = at / layout->row, x = at - y * layout->row, s = step_of(x, y);
    const int is_center = IS_CENTER(x, y, s), turn = IS_MAIN(x, y, s) ? s : -s;
    const int2 to_b = is_center ? (int2)(turn, -s) : x & s ? (int2)(0, s) : (int2)(s, 0); /* towards the parents */
    activate_vertex(layout, work, x + to_b.x, y + to_b.y);
    activate_vertex(layout, work, x - to_b.x, y - to_b.y);
    const int child = is_center ? s : s / 2;
    if (child < work->finest || child >= coarse)
        return;
    for (int k = 0; k < 4; k++) { /* children above, right, below, left of a centre; diagonally from a midpoint */
        const int dx = is_center ? (k == 1) - (k == 3) : k & 1 ? 1 : -1;
        const int dy = is_center ? (k == 2) - (k == 0) : k >> 1 ? 1 : -1;
        visit_child(layout, work, x + child * dx, y + child * dy, child, is_center ? k % 3 == 0 : !(k >> 1));
    }
}

/* Calls `propagate` for the vertices on the stack until it is empty. coarse: for the first vertex; for later vertices,
 * there is no limit */
INLINED void propagate_all(const Layout *layout, Work *work, int coarse)
{
    for (int vertices_left = (layout->side + 1) * (layout->side + 1); vertices_left > 0;
         vertices_left--) { /* each vertex is processed once */
        if (work->height == 2) {
            work->chunk = work->pool[CHUNK * work->chunk];
            work->height = CHUNK;
            if (work->chunk == NO_CHUNK)
                return;
        }
        propagate(layout, work, work->pool[CHUNK * work->chunk + --work->height], coarse);
        coarse = layout->side;
    }
}

kernel void refine_coarse(global const float *nearness, global const float *placed, global const uchar *states,
                          global uchar *active, global int *pool, global int *used, Layout layout, float max_error,
                          int coarse)
{
    if (get_global_id(0) > 0)
        return;
    const int root = layout.side / 2;
    *used = 0;
    Work work = {nearness, placed, states, active, max_error, coarse, pool, used, NO_CHUNK};
    add_chunk(&work);
    mark_corners(&layout, active, 0);
    mark_corners(&layout, active, layout.side);
    if (layout.side > 1) {
        visit_child(&layout, &work, root, root, root, 0);
        visit_child(&layout, &work, root, root, root, 1);
    }
    propagate_all(&layout, &work, layout.side);
}

kernel void refine(global const float *nearness, global const float *placed, global const uchar *states,
                   global uchar *active, global int *pool, global int *used, Layout layout, float max_error, int coarse)
{
    const int x = coarse * get_global_id(0), y = coarse * get_global_id(1), at = y * layout.row + x;
    const int corner = (x == 0 || x == layout.side) && (y == 0 || y == layout.side);
    if (x > layout.side || y > layout.side || corner || !active[at])
        return;
    Work work = {nearness, placed, states, active, max_error, 1, pool, used, NO_CHUNK};
    add_chunk(&work);
    work.pool[CHUNK * work.chunk + work.height++] = at;
    propagate_all(&layout, &work, coarse);
}
