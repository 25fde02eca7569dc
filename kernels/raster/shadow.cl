/* Shadows on what shows its own colours: images and objects made of images.
 *
 * Such colours hold the light that they were taken in. Where the pixel's point is out of the light's sight they keep the
 * light's ambient part. Normals come from the picture's depths: the smaller of the steps to either side, down and across.
 *
 * before: (height, width) the depths before the thing was drawn, with `blank` 0; other pixels stay. depth, valid, color:
 * the picture. Work-item: LANES pixels of a row. Cost: O(pixels). Determinism: every pixel on its own.
 */
#define SHADOWED
#include "lib/light.h"
#include "lib/screen.h"

/* A pixel's point in the world, or NaN */
typedef struct {
    floatl x, y, z;
} Point;

Point point_at(global const float *depth, Screen screen, intl x, intl y)
{
    const float *m = screen.to_world;
    const intl at = y * screen.width + x;
    const floatl z = (floatl)(gather(depth, at)), n = screen.perspective ? 1.0f / z : -z;
    const floatl px = to_floatl(x), py = to_floatl(y), inverse = 1.0f / (PIXEL_ROW(m, 3, px, py) + n * m[15]);
    const Point p = {(PIXEL_ROW(m, 0, px, py) + n * m[3]) * inverse, (PIXEL_ROW(m, 1, px, py) + n * m[7]) * inverse,
                     (PIXEL_ROW(m, 2, px, py) + n * m[11]) * inverse};
    return p;
}

/* The shorter of the steps from p back to a and on to b */
Point step_of(Point a, Point p, Point b)
{
    const Point back = {p.x - a.x, p.y - a.y, p.z - a.z}, on = {b.x - p.x, b.y - p.y, b.z - p.z};
    const floatl length_back = back.x * back.x + back.y * back.y + back.z * back.z;
    const floatl length_on = on.x * on.x + on.y * on.y + on.z * on.z;
    const intl forward = (length_on < length_back) | !(length_back < INFINITY); /* NaN: nothing there */
    const Point made = {pick(forward, on.x, back.x), pick(forward, on.y, back.y), pick(forward, on.z, back.z)};
    return made;
}

kernel void darken(global const float *before, global const float *depth, global const uchar *valid,
                   global channel *color, Screen screen, int blank, Light light SHADOW_PARAMETERS)
{
    const int first = get_global_id(0) * LANES, y = get_global_id(1);
    if (first >= screen.width || y >= screen.height)
        return;
    const intl x = min(first + lane_index, (intl)(screen.width - 1)), row = (intl)y;
    const Point p = point_at(depth, screen, x, row);
    const Point across = step_of(point_at(depth, screen, max(x - 1, (intl)0), row), p,
                                 point_at(depth, screen, min(x + 1, (intl)(screen.width - 1)), row));
    const Point down = step_of(point_at(depth, screen, x, max(row - 1, (intl)0)), p,
                               point_at(depth, screen, x, min(row + 1, (intl)(screen.height - 1))));
    floatl nx = across.y * down.z - across.z * down.y, ny = across.z * down.x - across.x * down.z;
    floatl nz = across.x * down.y - across.y * down.x;
    const floatl length_2 = nx * nx + ny * ny + nz * nz;
    const intl flat = !(length_2 > 0.0f); /* NaN, too: a pixel alone, or the picture's edge */
    const ToLight to = to_light(light, p.x, p.y, p.z);
    const floatl unit = pick(nx * to.x + ny * to.y + nz * to.z < 0.0f, (floatl)-1.0f, (floatl)1.0f) / sqrt(length_2);
    nx = pick(flat, to.x, nx * unit); /* on the light's side: which side is the outside is not known */
    ny = pick(flat, to.y, ny * unit);
    nz = pick(flat, to.z, nz * unit);
    const floatl visible = pick(to.shines, VISIBILITY(light, p.x, p.y, p.z, nx, ny, nz), (floatl)0.0f);
    const floatl left = light.ambient + (1.0f - light.ambient) * visible;
    for (int lane = 0; lane < LANES && first + lane < screen.width; lane++) {
        const size_t at = (size_t)y * screen.width + first + lane;
        const float share = ((const float *)&left)[lane];
        if (!valid[at] || !(share < 1.0f) || (!blank && before[at] == depth[at]))
            continue;
        for (int k = 0; k < 3; k++)
            color[3 * at + k] = to_channel(color[3 * at + k] * share);
    }
}
