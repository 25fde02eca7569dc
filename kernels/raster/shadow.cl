/* Shadows on what shows its own colours: images and objects made of images.
 *
 * Such colours hold the light that they were taken in. Where the pixel's point is out of the light's sight they keep
 * the light's ambient part. Normals come from the picture's depths: along x and y, of the neighbours `apart` pixels
 * away the one whose nearness differs less. What turns away from the light is dark, and fades before that over `fade`
 * of the cosine; with 0 that is left to the map, in which a solid's front hides its back.
 *
 * before: (height, width) the depths before the thing was drawn, with `blank` 0; other pixels stay. depth, color: the
 * picture. Work-item: LANES pixels of a row. Cost: O(pixels). Determinism: every pixel on its own.
 */
#define SHADOWED 1
#include "lib/light.h"
#include "lib/screen.h"

/* Nearness of pixels; EMPTY beside the picture and where there is nothing */
floatl nearness_at(global const float *depth, Screen screen, intl x, intl y)
{
    const intl inside = (x >= 0) & (x < screen.width) & (y >= 0) & (y < screen.height);
    const intl at = pick(inside, y * screen.width + x, (intl)0);
    const floatl z = (floatl)(gather(depth, at));
    return pick(inside & (z == z), screen.perspective ? 1.0f / z : -z, (floatl)EMPTY);
}

typedef struct {
    floatl x, y, z;
} Point;

/* In the world, relative to the screen's origin, what a pixel sees at a nearness */
Point point_at(Screen screen, floatl x, floatl y, floatl n)
{
    const float *m = screen.to_world;
    const floatl inverse = 1.0f / (PIXEL_ROW(m, 3, x, y) + n * m[15]);
    const Point p = {(PIXEL_ROW(m, 0, x, y) + n * m[3]) * inverse, (PIXEL_ROW(m, 1, x, y) + n * m[7]) * inverse,
                     (PIXEL_ROW(m, 2, x, y) + n * m[11]) * inverse};
    return p;
}

/* Along the surface, the way (dx, dy) from the point p of a pixel; a pixel alone is taken to be level. */
Point step_of(global const float *depth, Screen screen, intl x, intl y, int dx, int dy, floatl n, Point p)
{
    const floatl next = nearness_at(depth, screen, x + dx, y + dy), last = nearness_at(depth, screen, x - dx, y - dy);
    const intl forward = fabs(next - n) <= fabs(last - n);
    const floatl near = pick(forward, next, last), way = pick(forward, (floatl)1.0f, (floatl)-1.0f);
    const Point to = point_at(screen, to_floatl(x) + way * dx, to_floatl(y) + way * dy, pick(near > EMPTY, near, n));
    const Point made = {(to.x - p.x) * way, (to.y - p.y) * way, (to.z - p.z) * way};
    return made;
}

kernel void darken(global const float *before, global const float *depth, global channel *color, Screen screen,
                   int blank, int apart, float fade, Light light SHADOW_PARAMETERS)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= screen.width || row >= screen.height)
        return;
    const intl x = min(first + lane_index, (intl)(screen.width - 1)), y = (intl)row, at = y * screen.width + x;
    const floatl z = (floatl)(gather(depth, at)), z_before = (floatl)(gather(before, at));
    const intl drawn = (first + lane_index < screen.width) & (z == z) & (blank ? (intl)(z == z) : !(z == z_before));
    if (!any_lane(drawn))
        return;
    const floatl n = pick(drawn, screen.perspective ? 1.0f / z : -z, (floatl)(screen.perspective ? 1.0f : -1.0f));
    const Point p = point_at(screen, to_floatl(x), to_floatl(y), n);
    const Point across = step_of(depth, screen, x, y, apart, 0, n, p);
    const Point down = step_of(depth, screen, x, y, 0, apart, n, p);
    floatl nx = across.y * down.z - across.z * down.y, ny = across.z * down.x - across.x * down.z;
    floatl nz = across.x * down.y - across.y * down.x;
    const Direction ahead = towards(screen, p.x, p.y, p.z);
    const floatl unit = pick(nx * ahead.x + ny * ahead.y + nz * ahead.z > 0.0f, (floatl)-1.0f, (floatl)1.0f) /
                        sqrt(greater(nx * nx + ny * ny + nz * nz, (floatl)1e-37f)); /* towards the viewer */
    nx *= unit;
    ny *= unit;
    nz *= unit;
    const ToLight to = to_light(light, p.x, p.y, p.z);
    const floatl cosine = nx * to.x + ny * to.y + nz * to.z;
    const floatl faces = fade > 0.0f ? lesser(greater(cosine / fade, (floatl)0.0f), (floatl)1.0f) : (floatl)1.0f;
    const floatl visible = VISIBILITY(p.x, p.y, p.z, nx, ny, nz) * to.share * faces;
    const floatl left = light.ambient + (1.0f - light.ambient) * visible;
    for (int lane = 0; lane < LANES; lane++) {
        const float share = float_lane(left, lane);
        if (!int_lane(drawn, lane) || !(share < 1.0f))
            continue;
        const size_t pixel = 3 * ((size_t)row * screen.width + first + lane);
        for (int k = 0; k < 3; k++)
            color[pixel + k] = to_channel(color[pixel + k] * share);
    }
}
