/* From the quadtree to triangles (Pajarola, Sainz & Meng 2003, section 3.4).
 *
 * `activate` marks the vertices that a target needs: those whose error is seen larger than the tolerance (equation 5)
 * from the nearest point of their bounding sphere, which is within the target's view. Errors and spheres hold those of
 * all children, so every vertex can decide on its own, and no cracks arise. A triangle is part of the triangulation if
 * its vertex at the right angle is active and the one that would split it is not; it is drawn if all of it is. (The two
 * corners where the coarsest triangles have their right angles are always active.)
 *
 * Deviation from the paper: the distance is that of the sphere, not of the vertex, as the above demands.
 *
 * active: (side + 1, row). starts: of each row of vertices its triangles' count, then the number of its first one.
 * samples: (triangles, 3) y * width + x of each corner, counter-clockwise as the view sees them. projected:
 * (3 triangles, 4) the corners in the target's pixel space. places: (3 triangles, 4) their homogeneous pixel in the view
 * (x z, y z, z) and their quality |n z|. corners: (triangles, 3) their numbers.
 * Work-item: a row of vertices, or CHUNK corners. Cost: O(vertices) + O(triangles). Determinism: rows' and columns'
 * order.
 */
#include "depthmesh/tree.h"

#define CHUNK 1024

typedef struct {
    float eye[3];      /* the target's, in the view's camera's frame */
    float planes[5][4]; /* of what the target sees: a x + b y + c z + d >= 0 inside, unit normals */
    float scale;       /* pixels per scene unit: at distance 1 (perspective), everywhere (orthographic) */
    float tolerance;   /* pixels */
    int perspective;
} Viewer;

typedef struct {
    float dst_from_src[16]; /* from the view's pixel space to the target's, row by row */
} Placement;

kernel void activate(global const float *errors, global const float *radii, global const float *depths,
                     global uchar *active, Layout layout, Viewer viewer)
{
    const int y = get_global_id(0);
    if (y > layout.side)
        return;
    const size_t start = (size_t)y * layout.row;
    for (int first = 0; first <= layout.side; first += LANES) {
        const size_t at = start + first;
        const floatl error = load_lanes(errors + at), radius = load_lanes(radii + at);
        const intl x = first + lane_index;
        intl needed = (error >= 0.0f) & (first + lane_index <= layout.side);
        if (any_lane(needed)) {
            const Point p = point_of(&layout, to_floatl(x), (floatl)y, load_lanes(depths + at));
            const Point away = {p.x - viewer.eye[0], p.y - viewer.eye[1], p.z - viewer.eye[2]};
            const floatl distance = viewer.perspective ? fmax(sqrt(DOT(away, away)) - radius, (floatl)0.0f) : (floatl)1.0f;
            needed = needed & (error * viewer.scale >= viewer.tolerance * distance);
            for (int k = 0; k < 5; k++) {
                const float *plane = viewer.planes[k];
                needed = needed & (plane[0] * p.x + plane[1] * p.y + plane[2] * p.z + plane[3] >= -radius);
            }
        }
        store_bytes(to_ucharl(needed & 1), active + at);
    }
    if (y == 0 || y == layout.side) /* the corner at a coarsest triangle's right angle */
        active[start + layout.side - y] = 1;
}

/* One of the four triangles with their right angle at a vertex */
typedef struct {
    int2 a, b; /* its other corners; a, vertex, b run counter-clockwise */
    int drawn;
} Triangle;

/* The triangle towards (dx, dy) of the vertex p of step s, a midpoint or a corner: split by a centre or a cell's own */
Triangle triangle_of(const Layout *layout, global const uchar *active, global const uchar *states, global const uchar *cells,
                     int2 p, int s, int k)
{
    Triangle t = {p, p, 0};
    int2 splits;
    int state;
    if (IS_CENTER(p.x, p.y, s)) { /* k: above, right, below, left */
        const int2 to = (int2)(k == 1 ? s : k == 3 ? -s : 0, k == 2 ? s : k == 0 ? -s : 0), turned = (int2)(to.y, -to.x);
        splits = p + to;
        t.a = splits + turned;
        t.b = splits - turned;
        const int at = splits.y * layout->row + splits.x;
        if (active[at])
            return t;
        state = k == 0 || k == 3 ? STATE_B(states[at]) : STATE_A(states[at]);
    } else { /* k: upper left, upper right, lower left, lower right */
        const int2 to = (int2)(k & 1 ? 1 : -1, k >> 1 ? 1 : -1), end = p + s * to;
        if (end.x < 0 || end.x > layout->side || end.y < 0 || end.y > layout->side)
            return t;
        t.a = k == 0 || k == 3 ? (int2)(end.x, p.y) : (int2)(p.x, end.y);
        t.b = k == 0 || k == 3 ? (int2)(p.x, end.y) : (int2)(end.x, p.y);
        if (s > 1) {
            splits = p + (s / 2) * to;
            const int at = splits.y * layout->row + splits.x;
            if (active[at])
                return t;
            state = k >> 1 ? STATE_A(states[at]) : STATE_B(states[at]);
        } else {
            const int2 cell = min(p, end);
            if (cell.x >= layout->width - 1 || cell.y >= layout->height - 1)
                return t;
            const int byte = cells[cell.y * layout->pitch + cell.x];
            state = k >> 1 ? STATE_A(byte) : STATE_B(byte);
        }
    }
    t.drawn = state == DRAWN;
    return t;
}

/* The first active vertex of a row from x on, or one beyond the side */
int next_active(global const uchar *row, int x, int side)
{
    for (; x <= side; x++) {
        while (!(x & 7) && x <= side && !*(global const ulong *)(row + x)) /* rows start and end at whole words */
            x += 8;
        if (x <= side && row[x])
            break;
    }
    return x;
}

kernel void count_triangles(global const uchar *active, global const uchar *states, global const uchar *cells,
                            global int *starts, Layout layout)
{
    const int y = get_global_id(0);
    if (y > layout.side)
        return;
    int count = 0;
    for (int x = -1; (x = next_active(active + (size_t)y * layout.row, x + 1, layout.side)) <= layout.side;) {
        const int s = step_of(x, y);
        for (int k = 0; k < 4; k++)
            count += triangle_of(&layout, active, states, cells, (int2)(x, y), s, k).drawn;
    }
    starts[y] = count;
}

kernel void write_triangles(global const uchar *active, global const uchar *states, global const uchar *cells,
                            global const int *starts, global int *samples, Layout layout)
{
    const int y = get_global_id(0);
    if (y > layout.side)
        return;
    global int *next = samples + 3 * (size_t)starts[y];
    for (int x = -1; (x = next_active(active + (size_t)y * layout.row, x + 1, layout.side)) <= layout.side;) {
        const int s = step_of(x, y);
        for (int k = 0; k < 4; k++) {
            const Triangle t = triangle_of(&layout, active, states, cells, (int2)(x, y), s, k);
            if (!t.drawn)
                continue;
            next[0] = t.a.y * layout.width + t.a.x;
            next[1] = y * layout.width + x;
            next[2] = t.b.y * layout.width + t.b.x;
            next += 3;
        }
    }
}

/* Corners of triangles to the target's picture; first: the place of the first of `count`. */
kernel void place_corners(global const float *nearness, global const float *normals, global const int *samples,
                          global float *projected, global float *places, global int *corners, Layout layout,
                          Placement placement, int first, int count)
{
    const int start = get_global_id(0) * CHUNK;
    if (start >= count)
        return;
    const float *m = placement.dst_from_src, per_width = 1.0f / layout.width;
    global const float *facing = normals + (size_t)2 * layout.pitch * layout.height;
    for (int i = start; i < min(start + CHUNK, count); i += LANES) {
        const intl at = min(i + lane_index, (intl)(count - 1)), sample = (intl)(gather(samples, at));
        /* Whole numbers are divided one by one: a float's quotient is right to one row. */
        const intl guess = to_intl(to_floatl(sample) * per_width), rest = sample - guess * layout.width;
        const intl y = guess + pick(rest < 0, (intl)-1, pick(rest >= layout.width, (intl)1, (intl)0));
        const intl x = sample - y * layout.width, pixel = y * layout.pitch + x;
        const floatl n = (floatl)(gather(nearness, pixel)), fx = to_floatl(x), fy = to_floatl(y);
        const floatl z = layout.perspective ? 1.0f / n : (floatl)1.0f;
        const floatl made[8] = {z * (PIXEL_ROW(m, 0, fx, fy) + n * m[3]),
                                z * (PIXEL_ROW(m, 1, fx, fy) + n * m[7]),
                                z * (PIXEL_ROW(m, 2, fx, fy) + n * m[11]),
                                z * (PIXEL_ROW(m, 3, fx, fy) + n * m[15]),
                                fx * z,
                                fy * z,
                                z,
                                fabs((floatl)(gather(facing, pixel)))};
        for (int lane = 0; lane < LANES && i + lane < count; lane++) {
            const size_t to = (size_t)first + i + lane;
#define PART(k) ((const float *)&made[k])[lane]
            vstore4((float4)(PART(0), PART(1), PART(2), PART(3)), to, projected);
            vstore4((float4)(PART(4), PART(5), PART(6), PART(7)), to, places);
            corners[to] = to;
        }
    }
}
