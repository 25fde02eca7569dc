#ifndef LIB_LIGHT_H
#define LIB_LIGHT_H
/* Shading by one light: Lambert's law, highlights (Blinn 1977), and shadows from shadow maps (Williams 1978).
 *
 * With SHADOWED, the kernel has SHADOW_PARAMETERS. shadow_maps: (maps * size, size) depth images from the light, one
 * below the other; NaN where empty. shadow_views: (maps, SHADOW_VIEW); for each map, 16 numbers of the matrix from the
 * world to the map's pixel space, row by row, and the 4 numbers of the matrix row that yields planar depth.
 */
#include "lib/color.h"
#include "lib/taps.h"
#include "lib/vectors.h"

#ifndef LIT
#define LIT 0 /* 1: kernels shade their surfaces, and have `Light light` */
#endif
#ifndef SHADOWED
#define SHADOWED 0 /* 1: kernels also read shadow maps */
#endif

typedef struct {
    float vector[4];  /* unit direction to the light (w = 0), or its position (w = 1), in the world */
    float axis[4];    /* a spotlight's direction, and the cosine of half its cone's angle; -2 for other lights */
    float cone_rise;  /* increase of a spotlight's strength inside its cone, per unit of the cosine */
    float color[3];   /* red, green and blue; all 1: white */
    float ambient;    /* ambient part of the light, 0 to 1 */
    float specular;   /* strength of highlights */
    float shininess;  /* Blinn's exponent: higher for narrower highlights */
} Light;

#define SHADOW_VIEW 20

typedef struct {
    int maps, size;
    float texel_x, texel_y; /* sides of a texel in scene units; for perspective maps, at depth 1 */
    float bias; /* scene units by which things in a map may lie in front of their true surface */
} Shadow;

#if SHADOWED
#define SHADOW_PARAMETERS , global const float *shadow_maps, global const float *shadow_views, Shadow shadow
#define SHADOW_ARGUMENTS , shadow_maps, shadow_views, shadow
#define VISIBILITY(p, normal) visibility(p, normal SHADOW_ARGUMENTS)
#else
#define SHADOW_PARAMETERS
#define VISIBILITY(p, normal) (floatl)1.0f
#endif

/* The unit direction from a point to the light, and a spotlight's strength at the point, 0 to 1 */
typedef struct {
    Vector direction;
    floatl falloff;
} ToLight;

INLINED ToLight to_light(Light light, Vector p)
{
    const float *source = light.vector, *axis = light.axis;
    const Vector direction = {source[0] - source[3] * p.x, source[1] - source[3] * p.y, source[2] - source[3] * p.z};
    ToLight to;
    to.direction = normalized(direction);
    const floatl cosine = -(to.direction.x * axis[0] + to.direction.y * axis[1] + to.direction.z * axis[2]);
    to.falloff = clamp_lanes((cosine - axis[3]) * light.cone_rise, (floatl)0.0f, (floatl)1.0f);
    return to;
}

#if SHADOWED
#define SHADOW_FILTER_RADIUS 1.0f /* texels: greatest distance, along an axis, of the texels compared with a point */
#define SHADOW_BIAS 0.5f /* texels by which a point is moved further along the normal */

/* The visibility of the light from a point, 0 to 1. normal: the surface's normal there, of unit length.
 *
 * The point's depth is compared with the depths of four texels around it, and the four results are interpolated
 * (percentage-closer filtering, Reeves et al. 1987). On a map, a plane's nearness is linear. Its change from one texel
 * to the next is as if the plane moved along its normal, by the texel's side in the world times the cosine of the angle
 * between side and normal. So a point of the plane, moved along the normal by this distance, lies in front of all four
 * texels of the plane (docs/theory/shadows.md). SHADOW_BIAS makes up for curved surfaces and rounding. The shadow's
 * `bias` is for things that are drawn in slices: their maps are only as accurate as the slices' spacing.
 */
OUTLINED floatl visibility(Vector p, Vector normal SHADOW_PARAMETERS)
{
    const float middle = 0.5f * (shadow.size - 1), safe = SHADOW_BIAS * fmax(shadow.texel_x, shadow.texel_y);
    floatl visible = 1.0f;
    intl remaining = lane_index >= 0; /* mask of points that none of the maps read so far contains */
    for (int i = 0; i < shadow.maps; i++) {
        global const float *m = shadow_views + SHADOW_VIEW * i, *r = m + 16;
        float right[3], down[3]; /* vectors in the world, as long as SHADOW_FILTER_RADIUS texels where W is 1 */
        UNROLLED
        for (int axis = 0; axis < 3; axis++) {
            right[axis] = SHADOW_FILTER_RADIUS * shadow.texel_x * shadow.texel_x * (m[axis] - middle * m[8 + axis]);
            down[axis] = SHADOW_FILTER_RADIUS * shadow.texel_y * shadow.texel_y * (m[4 + axis] - middle * m[8 + axis]);
        }
        const floatl here = POINT_ROW(m, 2, p);
        const floatl tilt = fabs(right[0] * normal.x + right[1] * normal.y + right[2] * normal.z) +
                            fabs(down[0] * normal.x + down[1] * normal.y + down[2] * normal.z);
        const floatl off = here * (tilt + safe) + shadow.bias;
        const Vector moved = {p.x + off * normal.x, p.y + off * normal.y, p.z + off * normal.z};
        const floatl depth = POINT_ROW(r, 0, moved), w = POINT_ROW(m, 2, moved), inverse = 1.0f / w;
        const floatl u = POINT_ROW(m, 0, moved) * inverse, v = POINT_ROW(m, 1, moved) * inverse;
        const float last = shadow.size - 1;
        const intl seen = remaining & (w > 0.0f) & (u >= -0.5f) & (u <= last + 0.5f) & (v >= -0.5f) &
                          (v <= last + 0.5f);
        if (!any_lane(seen))
            continue;
        const Taps taps = clamped_taps(shadow.size, shadow.size, select_lanes(seen, u, (floatl)0.0f),
                                       select_lanes(seen, v, (floatl)0.0f));
        const int start = i * shadow.size * shadow.size;
#define IN_SIGHT(k) select_lanes((floatl)(gather(shadow_maps, taps.at[k] + start)) < depth, (floatl)0.0f, (floatl)1.0f)
        visible = select_lanes(seen, bilinear(taps, IN_SIGHT(0), IN_SIGHT(1), IN_SIGHT(2), IN_SIGHT(3)), visible);
        remaining = remaining & !seen;
    }
    return visible;
}
#endif

/* Applies the light to the colour of point p. normal: unit normal; ahead: unit viewing direction; visible: the light's
 * visibility, 0 to 1 */
INLINED void apply_light(Color *shade, Light light, Vector p, Vector normal, Vector ahead, floatl visible)
{
    const ToLight to = to_light(light, p);
    const floatl cosine = max_lanes(DOT(normal, to.direction), (floatl)0.0f);
    const floatl direct = (1.0f - light.ambient) * visible * to.falloff, diffuse = direct * cosine;
    floatl highlight = 0.0f;
    if (light.specular > 0.0f) {
        const Vector halfway = minus(to.direction, ahead);
        const floatl unit = 1.0f / sqrt(max_lanes(DOT(halfway, halfway), (floatl)1e-30f));
        const floatl along = max_lanes(DOT(normal, halfway) * unit, (floatl)1e-6f);
        highlight = select_lanes(cosine > 0.0f, direct * light.specular * exp2(light.shininess * log2(along)),
                                 (floatl)0.0f);
    }
    shade->r = shade->r * (light.ambient + light.color[0] * diffuse) + light.color[0] * highlight;
    shade->g = shade->g * (light.ambient + light.color[1] * diffuse) + light.color[1] * highlight;
    shade->b = shade->b * (light.ambient + light.color[2] * diffuse) + light.color[2] * highlight;
}
#endif
