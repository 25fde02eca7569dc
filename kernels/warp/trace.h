/* A ray of the target against the triangulated grid of the source, exactly, along its own epipolar line.
 *
 * In the source's pixel space the ray is Y(n) = start + n * centre, n being the nearness in the target, and its
 * image is a straight line, walked away from the epipole cell by cell and, in a cell, triangle by triangle.
 * The first triangle that the ray crosses is what it sees.
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

/* One triangle: nearness is q + gu (u - x) + gv (v - y). */
typedef struct {
    float q, gu, gv, x, y;
    int open;
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
    t.open = IS_OPEN(grid.cut, fmax(corner, fmax(q10, q01)), fmin(corner, fmin(q10, q01)));
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

/* The first triangle that the ray crosses between from and to: target nearness, BLOCKED, or EMPTY if it meets none. */
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
    const float inv_u = du != 0.0f ? fabs(1.0f / du) : INFINITY, inv_v = dv != 0.0f ? fabs(1.0f / dv) : INFINITY;
    float next_u = du > 0.0f ? (floor(u0) + 1.0f - u0) * inv_u : (du < 0.0f ? (u0 - ceil(u0) + 1.0f) * inv_u : INFINITY);
    float next_v = dv > 0.0f ? (floor(v0) + 1.0f - v0) * inv_v : (dv < 0.0f ? (v0 - ceil(v0) + 1.0f) * inv_v : INFINITY);
    float s = 0.0f, carried = 0.0f; /* distance walked; the surface's lead over the ray where it was left */
    int joined = 0;                 /* the surface was closed where it was left */
    while (s <= length) {
        const float end = fmin(fmin(next_u, next_v), length);
        const float middle = 0.5f * (s + end);
        const int x = clamp((int)floor(u0 + du * middle), 0, max(grid.width - 2, 0));
        const int y = clamp((int)floor(v0 + dv * middle), 0, max(grid.height - 2, 0));
        const float side_0 = u0 + du * s - x + v0 + dv * s - y - 1.0f;
        const float side_1 = u0 + du * end - x + v0 + dv * end - y - 1.0f;
        const int splits = side_0 * side_1 < 0.0f;
        float a = s;
        *samples += 1;
        for (int piece = 0; piece <= splits; piece++) {
            const float b = splits && piece == 0 ? s + (end - s) * side_0 / (side_0 - side_1) : end;
            const int upper = splits ? (piece == 0) == (side_0 > 0.0f) : side_0 + side_1 > 0.0f;
            const Triangle t = triangle_at(grid, x, y, upper);
            if (t.open) {
                joined = 0;
            } else {
                const float lead_a = t.q + t.gu * (u0 + du * a - t.x) + t.gv * (v0 + dv * a - t.y) - near0 - near_step * a;
                const float lead_b = t.q + t.gu * (u0 + du * b - t.x) + t.gv * (v0 + dv * b - t.y) - near0 - near_step * b;
                const float lead_0 = joined ? carried : lead_a;
                const int front = lead_0 < 0.0f && lead_b >= 0.0f;
                const int back = lead_0 >= 0.0f && lead_b < 0.0f;
                if (front || back) {
                    const float met = meet(ray, t);
                    if (IS_BEFORE(ray.perspective, met))
                        return shown & (front ? SHOWS_FRONT : SHOWS_BACK) ? met : BLOCKED;
                }
                carried = lead_b;
                joined = 1;
            }
            a = b;
        }
        if (end >= length)
            break;
        if (next_u <= end)
            next_u += inv_u;
        if (next_v <= end)
            next_v += inv_v;
        s = end;
    }
    return EMPTY;
}
