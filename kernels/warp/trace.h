/* A ray of the target against the triangulated grid of the source, exactly, along its own epipolar line.
 *
 * In the source's pixel space the ray is Y(n) = start + n * centre, n being the nearness in the target, and its
 * image is a straight line, walked away from the epipole. The first triangle that the ray crosses is what it sees.
 */
#include "lib/surface.h"

typedef struct {
    float4 start;  /* (U, V, W, Q) at target nearness 0 */
    float4 centre; /* the target's centre: the source's epipole */
    int perspective; /* the target is */
} Ray;

typedef struct {
    global const float *nearness;
    int width, height, pitch;
    Cut cut;
} Grid;

#define PAST 2e-3f /* pixels of the source by which a hit may lie past the walk's end: rounding */

/* One triangle: nearness is q + gu (u - x) + gv (v - y); high and low are its samples' extremes. */
typedef struct {
    float q, gu, gv, x, y, high, low;
} Triangle;

Triangle triangle_at(Grid grid, int x, int y, int upper)
{
    const int right = min(x + 1, grid.width - 1), down = min(y + 1, grid.height - 1);
    const float q10 = grid.nearness[y * grid.pitch + right], q01 = grid.nearness[down * grid.pitch + x];
    const float corner = upper ? grid.nearness[down * grid.pitch + right] : grid.nearness[y * grid.pitch + x];
    Triangle t;
    t.q = corner;
    t.gu = upper ? corner - q01 : q10 - corner;
    t.gv = upper ? corner - q10 : q01 - corner;
    t.x = upper ? x + 1 : x;
    t.y = upper ? y + 1 : y;
    t.high = fmax(corner, fmax(q10, q01));
    t.low = fmin(corner, fmin(q10, q01));
    return t;
}

/* Target nearness at which the ray meets the triangle's plane. */
float meet(Ray ray, Triangle t)
{
    const float4 s = ray.start, c = ray.centre;
    const float at_start = s.w - t.q * s.z - t.gu * (s.x - t.x * s.z) - t.gv * (s.y - t.y * s.z);
    const float per_unit = c.w - t.q * c.z - t.gu * (c.x - t.x * c.z) - t.gv * (c.y - t.y * c.z);
    return -at_start / per_unit;
}

/* The part of the ray's epipolar line to walk, in its major coordinate, and the ray's nearness along it. */
typedef struct {
    int u_major;
    float sign;         /* of the walk, along the major axis */
    float from, to;     /* major coordinate, in walking order */
    float tilt, minor;  /* minor coordinate = minor + tilt * major */
    float slope, level; /* nearness of the ray = level + slope * major */
} Walk;

/* The whole line: from the epipole (or the image's border) to the border (or the epipole). Empty if from passes to. */
Walk walk_of(Ray ray, int width, int height)
{
    const float4 s = ray.start, c = ray.centre;
    const float dir_u = s.x * c.z - c.x * s.z, dir_v = s.y * c.z - c.y * s.z, offset = c.x * s.y - c.y * s.x;
    Walk walk;
    walk.u_major = fabs(dir_u) >= fabs(dir_v);
    const float major = walk.u_major ? dir_u : dir_v;
    const float s_major = walk.u_major ? s.x : s.y, c_major = walk.u_major ? c.x : c.y;
    walk.sign = major < 0.0f ? -1.0f : 1.0f;
    walk.tilt = (walk.u_major ? dir_v : dir_u) / major;
    walk.minor = (walk.u_major ? -offset : offset) / major;
    walk.slope = (s.w * c.z - c.w * s.z) / major;
    walk.level = (c.w * s_major - s.w * c_major) / major;

    float low = 0.0f, high = (walk.u_major ? width : height) - 1;
    const float last_minor = (walk.u_major ? height : width) - 1;
    const float tilted = fabs(walk.tilt) < 1e-12f ? 1e-12f : walk.tilt;
    const float edge_0 = (-1e-3f - walk.minor) / tilted, edge_1 = (last_minor + 1e-3f - walk.minor) / tilted;
    low = fmax(low, fmin(edge_0, edge_1));
    high = fmin(high, fmax(edge_0, edge_1));
    if (c.z != 0.0f) {
        const float epipole = c_major / c.z;
        if (c.z * walk.sign > 0.0f)
            low = fmax(low, epipole);
        else
            high = fmin(high, epipole);
    }
    walk.from = walk.sign > 0.0f ? low : high;
    walk.to = walk.sign > 0.0f ? high : low;
    if (ray.perspective && s.z > 0.0f) /* beyond the point at infinity there is nothing to see */
        walk.to = walk.sign > 0.0f ? fmin(walk.to, s_major / s.z) : fmax(walk.to, s_major / s.z);
    if ((walk.to - walk.from) * walk.sign < 0.0f)
        walk.to = walk.from - walk.sign;
    return walk;
}

/* The first triangle that the ray crosses between from and to: target nearness, BLOCKED, or EMPTY if it meets none.
 *
 * The walk goes from edge to edge of the triangulation: columns, rows and diagonals. Two samples give the surface's
 * lead over the ray where it crosses an edge; where the lead changes its sign from one edge to the next, the ray
 * meets the triangle between them. Which edge comes next is not foreseeable: selections, no branches.
 */
float trace(Grid grid, Ray ray, Walk walk, int shown, uint *samples)
{
    const float length = (walk.to - walk.from) * walk.sign;
    if (!(length >= 0.0f))
        return EMPTY;
    const float du = walk.u_major ? walk.sign : walk.tilt * walk.sign;
    const float dv = walk.u_major ? walk.tilt * walk.sign : walk.sign;
    const float minor = walk.minor + walk.tilt * walk.from;
    const float u0 = walk.u_major ? walk.from : minor, v0 = walk.u_major ? minor : walk.from;
    const float near0 = walk.level + walk.slope * walk.from, near_step = walk.slope * walk.sign;
    const int last_x = grid.width - 1, last_y = grid.height - 1;

    /* Distance walked to the next column, row and diagonal, and from one to the next. */
    const float dd = du + dv, d0 = u0 + v0;
    const float step_u = fabs(1.0f / du), step_v = fabs(1.0f / dv), step_d = fabs(1.0f / dd);
    float to_u = du != 0.0f ? (du > 0.0f ? floor(u0) + 1.0f - u0 : u0 - ceil(u0) + 1.0f) * step_u : INFINITY;
    float to_v = dv != 0.0f ? (dv > 0.0f ? floor(v0) + 1.0f - v0 : v0 - ceil(v0) + 1.0f) * step_v : INFINITY;
    float to_d = dd != 0.0f ? (dd > 0.0f ? floor(d0) + 1.0f - d0 : d0 - ceil(d0) + 1.0f) * step_d : INFINITY;

    const int x0 = clamp((int)floor(u0), 0, max(last_x - 1, 0)), y0 = clamp((int)floor(v0), 0, max(last_y - 1, 0));
    const float first_side = d0 - x0 - y0 - 1.0f;
    const Triangle first = triangle_at(grid, x0, y0, first_side > 0.0f || (first_side == 0.0f && dd > 0.0f));
    float lead = first.q + first.gu * (u0 - first.x) + first.gv * (v0 - first.y) - near0;
    float high = first.high, low = first.low; /* of the edge's samples */
    float s = 0.0f;
    *samples += 1;
    while (s < length) {
        const float before = s, lead_before = lead, high_before = high, low_before = low;
        s = fmin(fmin(to_u, to_v), to_d);
        const int on_u = s == to_u, on_v = !on_u & (s == to_v), on_d = !(on_u | on_v);
        to_u += on_u ? step_u : 0.0f;
        to_v += on_v ? step_v : 0.0f;
        to_d += on_d ? step_d : 0.0f;
        const float u = u0 + du * s, v = v0 + dv * s;
        const float x = floor(on_u ? u + 0.5f : u), y = floor(on_v ? v + 0.5f : v);
        const float part = clamp(on_v ? u - x : v - y, 0.0f, 1.0f);
        const int ax = clamp((int)x + on_d, 0, last_x), bx = clamp((int)x + on_v, 0, last_x);
        const int ay = clamp((int)y, 0, last_y), by = clamp((int)y + !on_v, 0, last_y);
        const float a = grid.nearness[ay * grid.pitch + ax], b = grid.nearness[by * grid.pitch + bx];
        lead = a + part * (b - a) - near0 - near_step * s;
        high = fmax(a, b);
        low = fmin(a, b);
        *samples += 1;
        const int front = lead_before < 0.0f & lead >= 0.0f, back = lead_before >= 0.0f & lead < 0.0f;
        if (!(front | back) || IS_OPEN(grid.cut, fmax(high, high_before), fmin(low, low_before)))
            continue;
        const float middle = 0.5f * (before + s), um = u0 + du * middle, vm = v0 + dv * middle;
        const int xm = clamp((int)floor(um), 0, max(last_x - 1, 0)), ym = clamp((int)floor(vm), 0, max(last_y - 1, 0));
        const Triangle t = triangle_at(grid, xm, ym, um - xm + vm - ym > 1.0f);
        if (IS_OPEN(grid.cut, t.high, t.low)) /* at a corner, another triangle than the edges' */
            continue;
        const float met = meet(ray, t);
        const float w = ray.start.z + met * ray.centre.z;
        const float met_at = (walk.u_major ? ray.start.x + met * ray.centre.x : ray.start.y + met * ray.centre.y) / w;
        if ((met_at - walk.to) * walk.sign > PAST)
            return EMPTY;
        if (IS_BEFORE(ray.perspective, met))
            return shown & (front ? SHOWS_FRONT : SHOWS_BACK) ? met : BLOCKED;
    }
    return EMPTY;
}
