/* Projects Gaussians to splats (Zwicker et al. 2001, EWA splatting; Kerbl et al. 2023, section 4).
 *
 * The map from the world to pixels and nearness is linearised at each Gaussian's mean, but not farther than 15 % outside
 * of the picture. The covariance on the screen is the sum of a_i a_i^T over the three projected axes a_i, plus
 * `low_pass` on its diagonal. Determinants are sums of squares of cross products (Cauchy-Binet), which do not cancel. If
 * `antialiased`, the opacity falls as the covariance's area grows by `low_pass` (Yu et al. 2024, Mip-Splatting).
 * Deviation: a splat has a plane, through the mean and, for each pixel, through the place on its ray where the Gaussian
 * is densest. It is the regression of nearness on pixels; for a flat Gaussian it is the Gaussian's own plane.
 *
 * planes: (SHAPE + 3 * harmonics, pitch) values: mean (3, in the world), scales (3), rotation (4, a unit quaternion
 * w x y z), log2 of the opacity, and for each harmonic red, green and blue. `screen` maps points relative to `origin`,
 * the camera's centre in single precision. With SHADOWED, shadows of opaque things darken the colours (lib/light.h).
 * Outputs, from element `first` on: records: Splats. boxes: raster/boxes.h. keys: NOT_DRAWN, or the bits of a float that
 * orders Gaussians: the mean's depth if the camera is orthographic, otherwise its squared distance from `origin`, which
 * is the same in all faces of a cube. Work-item: STRIP packets of Gaussians. Cost: O(Gaussians). Determinism: Gaussians
 * are independent.
 */
#include "gaussians/harmonics.h"
#include "gaussians/splat.h"
#include "lib/light.h"
#include "raster/boxes.h"

#define SHAPE 11            /* planes before the harmonics' */
#define UNLINEARISED 0.15f  /* part of the picture's size; farther outside, the map is not linearised */
#define SHARP 0.01f         /* pixel^2, added to the covariance for the plane: splats seen edge-on have one, too */
#define HALF_LOG2_E 0.72134752f
#define PLANE_SIGMAS 3.5f   /* the plane is used up to so many standard deviations of the depth */

/* The gradient of row `row` of the map m over row 2, at a point where this quotient is `value` and row 2 is 1 /
 * `inverse` */
INLINED Vector gradient(const float *m, int row, floatl value, floatl inverse)
{
    const Vector made = {(m[4 * row] - value * m[8]) * inverse, (m[4 * row + 1] - value * m[9]) * inverse,
                         (m[4 * row + 2] - value * m[10]) * inverse};
    return made;
}

/* The changes of a coordinate with the gradient `to` along three axes, times their scales */
INLINED Vector along_axes(Vector to, Vector first, Vector second, Vector third, Vector scales)
{
    const Vector made = {scales.x * DOT(to, first), scales.y * DOT(to, second), scales.z * DOT(to, third)};
    return made;
}

/* Sets the splats' shape and plane, from the changes of u, v and nearness along the axes. Returns the determinant of
 * the covariance on the screen; reach_x: half the splats' width in pixels. */
INLINED floatl set_shape(Splats *splats, Vector u, Vector v, Vector n, float low_pass, int antialiased,
                         floatl *reach_x)
{
    const floatl uu = DOT(u, u), vv = DOT(v, v), wide = uu + low_pass, high = vv + low_pass;
    const Vector uv = cross_product(u, v);
    const floatl area = DOT(uv, uv), determinant = area + low_pass * (uu + vv) + low_pass * low_pass;
    const floatl inverse = 1.0f / (area + SHARP * (uu + vv) + SHARP * SHARP);
    const Vector nv = cross_product(n, v), un = cross_product(u, n);
    splats->nearness_x = (DOT(uv, nv) + SHARP * DOT(u, n)) * inverse;
    splats->nearness_y = (DOT(uv, un) + SHARP * DOT(v, n)) * inverse;
    splats->across = HALF_LOG2_E / wide;
    splats->along = sqrt(HALF_LOG2_E * wide / determinant);
    splats->lean = splats->along * DOT(u, v) / wide;
    if (antialiased)
        splats->strength += 0.5f * log2(area / determinant);
    const floatl least = max_lanes(splats->strength - LEAST_OPACITY_LOG2, (floatl)0.0f) * (1.0f / HALF_LOG2_E);
    splats->reach = sqrt(least * high) * 1.0001f;
    *reach_x = sqrt(least * wide) * 1.0001f;
    return determinant;
}

#if SHADOWED
#define SHADE_PARAMETERS , Light light SHADOW_PARAMETERS
#define SHADE_ARGUMENTS , light SHADOW_ARGUMENTS

/* The share of light that is left at points p in the shadows of opaque things. The points are moved towards the light
 * by a Gaussian's largest scale, so that surfaces within it cast no shadow on it. */
INLINED floatl share_of_light(Vector p, Vector scales SHADE_PARAMETERS)
{
    const ToLight to = to_light(light, p);
    const floatl off = max_lanes(max_lanes(scales.x, scales.y), scales.z);
    const Vector outside = {p.x + off * to.direction.x, p.y + off * to.direction.y, p.z + off * to.direction.z};
    return light.ambient + (1.0f - light.ambient) * to.falloff * VISIBILITY(outside, to.direction);
}
#else
#define SHADE_PARAMETERS
#define SHADE_ARGUMENTS
#endif

INLINED void project_packet(global const float *planes, int pitch, int degree, Vector origin, float low_pass,
                            int antialiased, float near_z, Screen screen, global float *records, global ushort *boxes,
                            global uint *keys SHADE_PARAMETERS)
{
#define SHAPE_PLANE(k) load_lanes(planes + (size_t)(k) * pitch)
    const Vector place = {SHAPE_PLANE(0), SHAPE_PLANE(1), SHAPE_PLANE(2)}, p = minus(place, origin);
    const float *m = screen.from_world;
    const floatl inverse = 1.0f / POINT_ROW(m, 2, p);
    Splats splats;
    splats.u = POINT_ROW(m, 0, p) * inverse;
    splats.v = POINT_ROW(m, 1, p) * inverse;
    splats.nearness = POINT_ROW(m, 3, p) * inverse;
    splats.strength = SHAPE_PLANE(10);
    const floatl z = screen.perspective ? POINT_ROW(m, 2, p) : -splats.nearness;
    const floatl w = SHAPE_PLANE(6), x = SHAPE_PLANE(7), y = SHAPE_PLANE(8), q = SHAPE_PLANE(9);
    const Vector first = {1.0f - 2.0f * (y * y + q * q), 2.0f * (x * y + w * q), 2.0f * (x * q - w * y)};
    const Vector second = {2.0f * (x * y - w * q), 1.0f - 2.0f * (x * x + q * q), 2.0f * (y * q + w * x)};
    const Vector third = {2.0f * (x * q + w * y), 2.0f * (y * q - w * x), 1.0f - 2.0f * (x * x + y * y)};
    const float beyond_x = UNLINEARISED * screen.width + 0.5f, beyond_y = UNLINEARISED * screen.height + 0.5f;
    const floatl u = clamp_lanes(splats.u, (floatl)-beyond_x, (floatl)(screen.width - 1.0f + beyond_x));
    const floatl v = clamp_lanes(splats.v, (floatl)-beyond_y, (floatl)(screen.height - 1.0f + beyond_y));
    const Vector scales = {SHAPE_PLANE(3), SHAPE_PLANE(4), SHAPE_PLANE(5)};
    const Vector by_u = along_axes(gradient(m, 0, u, inverse), first, second, third, scales);
    const Vector by_v = along_axes(gradient(m, 1, v, inverse), first, second, third, scales);
    const Vector by_n = along_axes(gradient(m, 3, splats.nearness, inverse), first, second, third, scales);
#undef SHAPE_PLANE
    floatl reach_x;
    const floatl determinant = set_shape(&splats, by_u, by_v, by_n, low_pass, antialiased, &reach_x);
    const floatl deep = PLANE_SIGMAS * sqrt(DOT(by_n, by_n)) * (screen.perspective ? z * z : (floatl)1.0f);
    splats.least = DEPTH_OF(screen.perspective, z + deep);
    splats.most = DEPTH_OF(screen.perspective, max_lanes(z - deep, (floatl)near_z));
    const intl drawn = (z > near_z) & (z < FARTHEST_DEPTH) & (splats.strength > LEAST_OPACITY_LOG2) &
                       (determinant > 0.0f) & (determinant < INFINITY) & isfinite_lanes(splats.along * splats.lean) &
                       isfinite_lanes(splats.nearness_x) & isfinite_lanes(splats.nearness_y);
    const Boxes box = boxes_within(splats.u - reach_x, splats.u + reach_x, splats.v - splats.reach,
                                   splats.v + splats.reach, drawn, screen);
    store_boxes(box, LANES, boxes);
    const intl seen = box.low_x <= box.high_x;
    const floatl far = screen.perspective ? DOT(p, p) : z;
    store_lanes(as_uintl(select_lanes(seen, as_intl(far), (intl)NOT_DRAWN)), keys);
    if (!any_lane(seen))
        return;
    global const float *coefficients = planes + (size_t)SHAPE * pitch;
    splats.color = harmonic_colors(coefficients, pitch, degree, view_direction(screen, p));
#if SHADOWED
    const floatl share = share_of_light(p, scales SHADE_ARGUMENTS);
    splats.color.r *= share;
    splats.color.g *= share;
    splats.color.b *= share;
#endif
    store_splats(splats, records);
}

kernel void project_gaussians(global const float *planes, int pitch, int degree, float origin_x, float origin_y,
                              float origin_z, float low_pass, int antialiased, float near_z, Screen screen, int first,
                              global float *records, global ushort *boxes, global uint *keys SHADE_PARAMETERS)
{
    const int from = get_global_id(0) * STRIP * LANES;
    const Vector origin = {origin_x, origin_y, origin_z};
    for (int i = from; i < min(from + STRIP * LANES, pitch); i += LANES) {
        const size_t to = (size_t)first + i;
        project_packet(planes + i, pitch, degree, origin, low_pass, antialiased, near_z, screen, records + RECORD * to,
                       boxes + 4 * to, keys + to SHADE_ARGUMENTS);
    }
}
