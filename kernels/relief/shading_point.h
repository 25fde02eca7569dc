#ifndef RELIEF_SHADING_POINT_H
#define RELIEF_SHADING_POINT_H
/* The shading point of a pixel on a relief: its place on the maps, its normal, and the pixel's footprint. */
#include "lib/footprint.h"
#include "lib/light.h"
#include "relief/entry.h"

#define FOCUS 0.1f /* least divisor: near centres of curvature, divisors approach 0 */

/* The points of the relief that LANES pixels show: their places on the maps, positions and normals */
typedef struct {
    ReliefRay place; /* u, v, level */
    Track track;
    Vector ahead, point;
    Vector normal; /* the quadric's normal */
    Vector from_entry; /* from the entry to the point; with exact distances, from the base right above the point */
    floatl below;      /* depth below the base (where depth is 0), in scene units */
} ShadingPoint;

/* Converts a gradient on the base, (x, y) in its frame, to the parallel surface at the depth `below`. Where the base
 * has curvature k, lengths on that surface are 1 + k `below` times as long, so the gradient is divided by this
 * factor. */
INLINED void carry_below(const Entry *e, floatl below, floatl *x, floatl *y)
{
    const floatl xx = 1.0f + 2.0f * e->a * below, xy = e->c * below, yy = 1.0f + 2.0f * e->b * below;
    const floatl inverse = 1.0f / max_lanes(xx * yy - xy * xy, (floatl)FOCUS);
    const floatl carried_x = (yy * *x - xy * *y) * inverse;
    *y = (xx * *y - xy * *x) * inverse;
    *x = carried_x;
}

/* Sets the normal to the quadric's normal right above the point. */
INLINED void set_normal(ShadingPoint *shading, const Entry *e, int quadric)
{
    Vector x, y, normal = e->normal;
    tangents_of(e, &x, &y);
    floatl px = DOT(shading->from_entry, x), py = DOT(shading->from_entry, y);
    shading->normal = normal;
    if (!quadric)
        return;
    carry_below(e, shading->below, &px, &py);
    const floatl along_x = -2.0f * quadric_form(e, px, py, 1.0f, 0.0f),
                 along_y = -2.0f * quadric_form(e, px, py, 0.0f, 1.0f);
    normal.x += along_x * x.x + along_y * y.x;
    normal.y += along_x * x.y + along_y * y.y;
    normal.z += along_x * x.z + along_y * y.z;
    shading->normal = normalized(normal);
}

/* The shading point's normal, tilted by the rises of the heights over a texel along u and along v, in HEIGHT_UNITs.
 * Slopes are measured on the surface that is parallel to the base and contains the point. The result is not
 * normalized. */
INLINED Vector relief_normal_by_rises(const ShadingPoint *shading, const Entry *e, floatl across, floatl down,
                                      float scale, int quadric)
{
    const HeightMap map = shading->track.map;
    const float rise = scale * HEIGHT_UNIT;
    const floatl du = across * to_floatl(map.width) * rise, dv = down * to_floatl(map.height) * rise;
    const Vector normal = shading->normal;
    Vector slope = combined(du, e->along_u, dv, e->along_v);
    if (quadric) {
        Vector x, y;
        tangents_of(e, &x, &y);
        floatl sx = DOT(slope, x), sy = DOT(slope, y);
        carry_below(e, shading->below, &sx, &sy);
        /* The slope is rotated like the normal, from its direction at the entry to its direction at the point. */
        const Vector there = combined(sx, x, sy, y);
        const floatl part = DOT(there, normal) / max_lanes(1.0f + DOT(normal, e->normal), (floatl)FOCUS);
        slope.x = there.x - part * (normal.x + e->normal.x);
        slope.y = there.y - part * (normal.y + e->normal.y);
        slope.z = there.z - part * (normal.z + e->normal.z);
    }
    return minus(normal, slope);
}

/* The shading point of the pixel (px, py): its ray, t scene units behind the entry, is at nearness n and at (u, v) */
INLINED ShadingPoint shading_point_at(const Relief *relief, const Entry *e, floatl px, floatl py, floatl n, floatl u,
                                      floatl v, floatl t, intl mine)
{
    ShadingPoint shading;
    shading.point = point_at(relief->screen, px, py, n);
    shading.ahead = view_direction(relief->screen, shading.point);
    shading.place.u = WRAPPED_UV(CLAMPED_U, u);
    shading.place.v = WRAPPED_UV(CLAMPED_V, v);
    shading.place.du = shading.place.dv = 0.0f;
    shading.place.level = level_of(relief, e, PIXEL_SIZE(relief, n), mine);
    shading.track = track_of(&shading.place, relief->levels);
    const Track k = shading.track;
    shading.below = relief->scale * (1.0f - HEIGHT_UNIT * height_in(relief->texels, k.map, k.x, k.y));
    shading.from_entry = WALKS && relief->quadric ? scaled(e->normal, -shading.below) : scaled(shading.ahead, t);
    set_normal(&shading, e, relief->quadric);
    return shading;
}

#if ANISOTROPIC
/* The slopes of the bilinear heights at (x, y), per texel along u and along v */
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

/* The change of u and v from a pixel to the next, on the tangent plane of the relief that the pixel shows */
INLINED UvSteps relief_uv_steps(const Relief *relief, const Entry *e, const ShadingPoint *shading, floatl n,
                                int anisotropy)
{
    floatl across, down;
    rises_at(relief->texels, shading->track.map, shading->track.x, shading->track.y, &across, &down);
    const Vector tilted = relief_normal_by_rises(shading, e, across, down, relief->scale, relief->quadric);
    return uv_steps(relief->screen, n, shading->ahead, tilted, e->along_u, e->along_v, anisotropy);
}
#endif

#if LIT
/* A point's normal, tilted by the slopes of the heights, which are measured over two texels of the level */
INLINED Vector relief_normal_by_slope(const Relief *relief, const Entry *e, const ShadingPoint *shading)
{
    global const uint *texels = relief->texels;
    const Track k = shading->track;
    const floatl across = height_in(texels, k.map, k.x + 1.0f, k.y) - height_in(texels, k.map, k.x - 1.0f, k.y);
    const floatl down = height_in(texels, k.map, k.x, k.y + 1.0f) - height_in(texels, k.map, k.x, k.y - 1.0f);
    return normalized(relief_normal_by_rises(shading, e, 0.5f * across, 0.5f * down, relief->scale, relief->quadric));
}

/* A normal tilted by a value of the normal map: x along u, y along v */
INLINED Vector relief_normal_by_map(Vector normal, const Entry *e, Vector part)
{
    Vector x, y;
    tangents_of(e, &x, &y);
    /* v may run in the direction of -y */
    const floatl across = select_lanes(DOT(e->along_v, y) < 0.0f, (floatl)-1.0f, (floatl)1.0f) * part.y;
    return normalized(plus_scaled(combined(part.z, normal, part.x, x), across, y));
}
#endif
#endif
