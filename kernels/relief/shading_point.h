#ifndef RELIEF_SHADING_POINT_H
#define RELIEF_SHADING_POINT_H
/* The shading point of a pixel on a relief: its place on the maps, its normal, and the pixel's footprint. */
#include "lib/footprint.h"
#include "lib/light.h"
#include "relief/entry.h"

/* The points of the relief that LANES pixels show: their places on the maps, and the rays, whose hits lie t after their
 * entries */
typedef struct {
    ReliefRay place; /* u, v, level */
    Track track;
    Vector ahead, point;
    Vector normal; /* of the quadric */
    floatl t;
} ShadingPoint;

/* The quadric's normal where a ray in direction d is after t */
INLINED Vector normal_at(const Entry *e, Vector d, floatl t, int quadric)
{
    Vector x, y, normal = e->normal;
    if (!quadric)
        return normal;
    tangents_of(e, &x, &y);
    const floatl px = t * DOT(d, x), py = t * DOT(d, y);
    const floatl along_x = -2.0f * quadric_form(e, px, py, 1.0f, 0.0f),
                 along_y = -2.0f * quadric_form(e, px, py, 0.0f, 1.0f);
    normal.x += along_x * x.x + along_y * y.x;
    normal.y += along_x * x.y + along_y * y.y;
    normal.z += along_x * x.z + along_y * y.z;
    return normalized(normal);
}

/* A normal tilted by how much the height rises over a texel, along u and along v, in HEIGHT_UNITs; not of unit
 * length */
INLINED Vector relief_normal_by_rises(Vector normal, const Entry *e, HeightMap map, floatl across, floatl down,
                                      float scale)
{
    const float rise = scale * HEIGHT_UNIT;
    const floatl du = across * to_floatl(map.width) * rise, dv = down * to_floatl(map.height) * rise;
    const Vector tilted = {normal.x - du * e->along_u.x - dv * e->along_v.x,
                           normal.y - du * e->along_u.y - dv * e->along_v.y,
                           normal.z - du * e->along_u.z - dv * e->along_v.z};
    return tilted;
}

/* At (px, py) in the picture, where the ray has come t beyond its entry to (u, v) */
INLINED ShadingPoint shading_point_at(const Relief *relief, const Entry *e, floatl px, floatl py, floatl n, floatl u,
                                      floatl v, floatl t, intl mine)
{
    ShadingPoint shading;
    shading.point = point_at(relief->screen, px, py, n);
    shading.ahead = view_direction(relief->screen, shading.point);
    shading.t = t;
    shading.place.u = WRAPPED_UV(CLAMPED_U, u);
    shading.place.v = WRAPPED_UV(CLAMPED_V, v);
    shading.place.du = shading.place.dv = 0.0f;
    shading.place.level = level_of(relief, e, PIXEL_SIZE(relief, n), mine);
    shading.track = track_of(&shading.place, relief->levels);
    shading.normal = normal_at(e, shading.ahead, t, relief->quadric);
    return shading;
}

#if ANISOTROPIC
/* The rises of the bilinear surface at (x, y) */
INLINED void rises_at(global const uint *texels, HeightMap map, floatl x, floatl y, floatl *across, floatl *down)
{
    FLOOR(x, x0, ix)
    FLOOR(y, y0, iy)
    const intl tx = WRAPPED(CLAMPED_U, x0, ix, map.width, map.per_width),
               ty = WRAPPED(CLAMPED_V, y0, iy, map.height, map.per_height);
    const Patch p = read_cell(texels, map, ix, iy, tx, ty);
    const floatl twist = p.aa - p.ab - p.ba + p.bb;
    *across = p.ab - p.aa + (y - y0) * twist;
    *down = p.ba - p.aa + (x - x0) * twist;
}

/* By how much u and v change over a pixel: on the tangent plane of the relief where the pixel sees it */
INLINED UvSteps relief_uv_steps(const Relief *relief, const Entry *e, const ShadingPoint *shading, floatl n,
                                int anisotropy)
{
    floatl across, down;
    rises_at(relief->texels, shading->track.map, shading->track.x, shading->track.y, &across, &down);
    const Vector tilted = relief_normal_by_rises(shading->normal, e, shading->track.map, across, down, relief->scale);
    return uv_steps(relief->screen, n, shading->ahead, tilted, e->along_u, e->along_v, anisotropy);
}
#endif

#if LIT
/* A normal tilted by the heights' slopes, over two texels of the level */
INLINED Vector relief_normal_by_slope(Vector normal, const Entry *e, global const uint *texels, Track k, float scale)
{
    const floatl across = height_in(texels, k.map, k.x + 1.0f, k.y) - height_in(texels, k.map, k.x - 1.0f, k.y);
    const floatl down = height_in(texels, k.map, k.x, k.y + 1.0f) - height_in(texels, k.map, k.x, k.y - 1.0f);
    return normalized(relief_normal_by_rises(normal, e, k.map, 0.5f * across, 0.5f * down, scale));
}

/* A normal tilted by one of a map, x along u, y along v */
INLINED Vector relief_normal_by_map(Vector normal, const Entry *e, Vector part)
{
    Vector x, y;
    tangents_of(e, &x, &y);
    /* v may run against y. */
    const floatl across = select_lanes(DOT(e->along_v, y) < 0.0f, (floatl)-1.0f, (floatl)1.0f) * part.y;
    const Vector tilted = {part.z * normal.x + part.x * x.x + across * y.x,
                           part.z * normal.y + part.x * x.y + across * y.y,
                           part.z * normal.z + part.x * x.z + across * y.z};
    return normalized(tilted);
}
#endif
#endif
