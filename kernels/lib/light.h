#ifndef LIB_LIGHT_H
#define LIB_LIGHT_H
/* One light: Lambert's law, highlights (Blinn 1977), shadows by maps (Williams 1978).
 *
 * SHADOWED: the kernel has `global const float *shadow_maps, Shadow shadow`: depth images as the light sees the scene,
 * one below the other; NaN where there is nothing.
 */
#include "lib/color.h"
#include "lib/pixelspace.h"

#ifndef LIT
#define LIT 0 /* 1: kernels that draw light what they draw, and have `Light light` */
#endif
#ifndef SHADOWED
#define SHADOWED 0 /* 1: they also ask what the light sees */
#endif


typedef struct {
    float vector[4];  /* towards the light, unit length (w = 0), or its position (w = 1), in the world */
    float axis[4];    /* of a spot: where it goes, unit length; cosine of half its angle, -2: shines everywhere */
    float cone_rise;  /* of a spot: how fast it gets full inside of that, per cosine */
    float color[3];   /* of what it lights straight on; 1 is white */
    float ambient;    /* part of the light that comes from everywhere, 0 to 1 */
    float specular;   /* highlight: its strength, */
    float shininess;  /* and how narrow it is */
} Light;

#define MAPS_MOST 6

typedef struct {
    float from_world[16 * MAPS_MOST]; /* pixel space of each map, row by row */
    float depth_row[4 * MAPS_MOST];   /* planar depth in it */
    int maps, size;
    float texel_x, texel_y; /* sides of a texel: in the world, or (perspective) at depth 1 */
    float grain; /* scene units by which the thing itself may lie before its true surface in a map */
} Shadow;

#if SHADOWED
#define SHADOW_PARAMETERS , global const float *shadow_maps, Shadow shadow
#define VISIBILITY(x, y, z, nx, ny, nz) visibility(shadow_maps, shadow, x, y, z, nx, ny, nz)
#else
#define SHADOW_PARAMETERS
#define VISIBILITY(x, y, z, nx, ny, nz) (floatl)1.0f
#endif

/* From a point towards the light: unit vector, and the share of the light that goes there: less than 1 beside a cone */
typedef struct {
    floatl x, y, z, share;
} ToLight;

ToLight to_light(Light light, floatl x, floatl y, floatl z)
{
    ToLight to;
    to.x = light.vector[0] - light.vector[3] * x;
    to.y = light.vector[1] - light.vector[3] * y;
    to.z = light.vector[2] - light.vector[3] * z;
    const floatl unit = 1.0f / sqrt(greater(to.x * to.x + to.y * to.y + to.z * to.z, (floatl)1e-30f));
    to.x *= unit;
    to.y *= unit;
    to.z *= unit;
    const floatl cosine = -(to.x * light.axis[0] + to.y * light.axis[1] + to.z * light.axis[2]);
    to.share = lesser(greater((cosine - light.axis[3]) * light.cone_rise, (floatl)0.0f), (floatl)1.0f);
    return to;
}

#if SHADOWED
#define SHADOW_REACH 1.0f /* texels, along both axes: from a point to those that it is compared with */
#define SHADOW_SLACK 0.5f /* texels */

/* How far is the point in sight of the light, 0 to 1? n: the surface's own normal there, unit length.
 *
 * Four texels around the point are compared and weighed (percentage-closer filtering, Reeves et al. 1987). On a map a
 * plane's nearness is linear: from one texel to the next it changes as if the plane were lifted by a texel's side, in
 * the world, times the cosine between that side and the plane's normal. A point that is moved by as much along the
 * normal lies before all of its own plane's texels (docs/theory/shadows.md). SHADOW_SLACK is for surfaces that are no
 * planes, and for rounding; the grain for slices.
 */
floatl visibility(global const float *shadow_maps, Shadow shadow, floatl x, floatl y, floatl z, floatl nx, floatl ny,
                  floatl nz)
{
    const float middle = 0.5f * (shadow.size - 1), safe = SHADOW_SLACK * fmax(shadow.texel_x, shadow.texel_y);
    floatl visible = 1.0f;
    intl open = lane_index >= 0; /* not seen in a map yet */
    for (int i = 0; i < shadow.maps; i++) {
        const float *m = shadow.from_world + 16 * i, *r = shadow.depth_row + 4 * i;
        float right[3], down[3]; /* as long as SHADOW_REACH texels, where W is 1 */
        for (int axis = 0; axis < 3; axis++) {
            right[axis] = SHADOW_REACH * shadow.texel_x * shadow.texel_x * (m[axis] - middle * m[8 + axis]);
            down[axis] = SHADOW_REACH * shadow.texel_y * shadow.texel_y * (m[4 + axis] - middle * m[8 + axis]);
        }
        const floatl here = m[8] * x + m[9] * y + m[10] * z + m[11];
        const floatl tilt = fabs(right[0] * nx + right[1] * ny + right[2] * nz) +
                            fabs(down[0] * nx + down[1] * ny + down[2] * nz);
        const floatl off = here * (tilt + safe) + shadow.grain;
        const floatl px = x + off * nx, py = y + off * ny, pz = z + off * nz;
        const floatl depth = r[0] * px + r[1] * py + r[2] * pz + r[3];
        const floatl w = m[8] * px + m[9] * py + m[10] * pz + m[11], inverse = 1.0f / w;
        const floatl u = (m[0] * px + m[1] * py + m[2] * pz + m[3]) * inverse;
        const floatl v = (m[4] * px + m[5] * py + m[6] * pz + m[7]) * inverse;
        const float last = shadow.size - 1;
        const intl seen = open & (w > 0.0f) & (u >= -0.5f) & (u <= last + 0.5f) & (v >= -0.5f) & (v <= last + 0.5f);
        if (!any_lane(seen))
            continue;
        const floatl cu = pick(seen, lesser(greater(u, (floatl)0.0f), (floatl)last), (floatl)0.0f);
        const floatl cv = pick(seen, lesser(greater(v, (floatl)0.0f), (floatl)last), (floatl)0.0f);
        const floatl u0 = lesser(truncated(cu), (floatl)(last - 1.0f)), v0 = lesser(truncated(cv), (floatl)(last - 1.0f));
        const floatl fu = cu - u0, fv = cv - v0;
        const intl aa = (to_intl(v0) + i * shadow.size) * shadow.size + to_intl(u0);
        const intl ab = aa + 1, ba = aa + shadow.size, bb = ba + 1;
#define IN_SIGHT(at) pick((floatl)(gather(shadow_maps, at)) < depth, (floatl)0.0f, (floatl)1.0f)
        const floatl top = (1.0f - fu) * IN_SIGHT(aa) + fu * IN_SIGHT(ab);
        const floatl bottom = (1.0f - fu) * IN_SIGHT(ba) + fu * IN_SIGHT(bb);
        visible = pick(seen, (1.0f - fv) * top + fv * bottom, visible);
        open = open & !seen;
    }
    return visible;
}
#endif

/* Lights a colour of the point (x, y, z); n: unit normal; v: unit vector to the viewer; visible: 0 to 1. */
void shine(Color *shade, Light light, floatl x, floatl y, floatl z, floatl nx, floatl ny, floatl nz, floatl vx, floatl vy,
           floatl vz, floatl visible)
{
    const ToLight to = to_light(light, x, y, z);
    const floatl cosine = greater(nx * to.x + ny * to.y + nz * to.z, (floatl)0.0f);
    const floatl direct = (1.0f - light.ambient) * visible * to.share, diffuse = direct * cosine;
    floatl highlight = 0.0f;
    if (light.specular > 0.0f) {
        const floatl hx = to.x + vx, hy = to.y + vy, hz = to.z + vz;
        const floatl unit = 1.0f / sqrt(greater(hx * hx + hy * hy + hz * hz, (floatl)1e-30f));
        const floatl along = greater((nx * hx + ny * hy + nz * hz) * unit, (floatl)1e-6f);
        highlight = pick(cosine > 0.0f, direct * light.specular * exp2(light.shininess * log2(along)), (floatl)0.0f);
    }
    shade->r = shade->r * (light.ambient + light.color[0] * diffuse) + light.color[0] * highlight;
    shade->g = shade->g * (light.ambient + light.color[1] * diffuse) + light.color[1] * highlight;
    shade->b = shade->b * (light.ambient + light.color[2] * diffuse) + light.color[2] * highlight;
}
#endif
