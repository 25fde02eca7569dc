#ifndef SLICING_SLICE_NORMALS_H
#define SLICING_SLICE_NORMALS_H
/* Normals of surfaces drawn by slices, and the footprint of a pixel on them.
 *
 * Slopes of heights are measured on the slice through the point, a triangle with all corners at the point's height
 * above the base. Where the base has curvature k, lengths on the slice at distance d above the base are 1 + k d times
 * as long, so the same heights are less steep there.
 */
#include "lib/footprint.h"
#include "lib/light.h"
#include "slicing/prisms.h"

/* The point of each lane's triangle at a pixel's centre: weights of the second and third corner, u and v, and the
 * differences of u and v from the first corner to the second and third */
typedef struct {
    intl corner[3]; /* of the base */
    floatl second, third;
    floatl u, v, u_second, v_second, u_third, v_third;
} SlicePoint;

/* The point of a triangle with these weights of its second and third corner */
INLINED SlicePoint slice_point_of(const Context *context, intl triangle, floatl second, floatl third)
{
    SlicePoint p;
    floatl u[3], v[3];
    for (int k = 0; k < 3; k++) {
        const intl at = PRISM_CORNERS * triangle + k;
        p.corner[k] = (intl)(gather(context->corners, at));
        gather_pairs(context->uv, 2 * p.corner[k], &u[k], &v[k]);
    }
    p.second = second, p.third = third;
    p.u_second = u[1] - u[0], p.v_second = v[1] - v[0];
    p.u_third = u[2] - u[0], p.v_third = v[2] - v[0];
    p.u = u[0] + second * p.u_second + third * p.u_third;
    p.v = v[0] + second * p.v_second + third * p.v_third;
    return p;
}

#if LIT || ANISOTROPIC
#define HEIGHT(u, v) height_at(context->heights, context->map_width, context->map_height, u, v)

typedef struct {
    Vector second, third;
    floatl h;
} SliceSides;

/* The weighted mean of the corners' vectors at a point */
INLINED Vector mean_by_shares(const SlicePoint *p, const Vector *of_corner)
{
    const Vector a = minus(of_corner[1], of_corner[0]), b = minus(of_corner[2], of_corner[0]);
    return plus_scaled(plus_scaled(of_corner[0], p->second, a), p->third, b);
}

/* The slice through the point `seen` (world): its sides from the first corner, and its height h, 0 to 1 */
INLINED SliceSides sides_of_slice(const Context *context, const SlicePoint *p, intl triangle, Vector seen)
{
    Vector base[3], up[3];
    for (int k = 0; k < 3; k++) {
        const intl at = PRISM_CORNERS * triangle + 3 + k;
        base[k] = vector_at(context->points, p->corner[k]);
        up[k] = minus(vector_at(context->points, (intl)(gather(context->corners, at))), base[k]);
    }
    const Vector above = mean_by_shares(p, up), from_base = minus(seen, mean_by_shares(p, base));
    const floatl h = clamp_lanes(DOT(from_base, above) / DOT(above, above), (floatl)0.0f, (floatl)1.0f);
    const SliceSides sides = {plus_scaled(minus(base[1], base[0]), h, minus(up[1], up[0])),
                              plus_scaled(minus(base[2], base[0]), h, minus(up[2], up[0])), h};
    return sides;
}

/* Gradients of u and v on a slice: at right angles to `normal`, with the exact changes of u and v along both sides */
INLINED void gradients_on_slice(const SlicePoint *p, const SliceSides *sides, Vector normal, Vector *along_u,
                                Vector *along_v)
{
    const Vector across = cross_product(sides->third, normal), down = cross_product(normal, sides->second);
    const floatl area = DOT(across, sides->second);
    const floatl inverse = select_lanes(fabs(area) > 1e-30f, 1.0f / area, (floatl)0.0f);
    *along_u = combined(p->u_second * inverse, across, p->u_third * inverse, down);
    *along_v = combined(p->v_second * inverse, across, p->v_third * inverse, down);
}

/* The slice's `normal`, tilted by the slopes of the height map. over_u, over_v: change of height per unit of u and of
 * v, where heights go from 0 to 1. */
INLINED Vector slice_normal_by_rises(const Context *context, const SlicePoint *p, const SliceSides *sides,
                                     Vector normal, floatl over_u, floatl over_v)
{
    const float rise = context->spacing * context->slices;
    Vector along_u, along_v;
    gradients_on_slice(p, sides, normal, &along_u, &along_v);
    return normalized(minus(normal, combined(over_u * rise, along_u, over_v * rise, along_v)));
}
#endif

#if ANISOTROPIC
/* The change of u and v from a pixel to the next, on the tangent plane of the surface that the pixel shows */
INLINED UvSteps slice_uv_steps(const Context *context, Vector ahead, floatl n, const SlicePoint *p,
                               const SliceSides *sides, int anisotropy)
{
    const Vector across = normalized(cross_product(sides->second, sides->third));
    const Vector base = scaled(across, select_lanes(DOT(across, ahead) > 0.0f, (floatl)-1.0f, (floatl)1.0f));
    /* Between texel centres, heights are linear along u and along v. The footprint needs these slopes; light uses means
     * of two neighbouring slopes. */
    const float width = context->map_width, height = context->map_height;
    const floatl left = (floor_lanes(p->u * width - 0.5f) + 0.5f) / width,
                 upper = (floor_lanes(p->v * height - 0.5f) + 0.5f) / height;
    const floatl by_u = (HEIGHT(left + 1.0f / width, p->v) - HEIGHT(left, p->v)) * width;
    const floatl by_v = (HEIGHT(p->u, upper + 1.0f / height) - HEIGHT(p->u, upper)) * height;
    Vector along_u, along_v;
    gradients_on_slice(p, sides, base, &along_u, &along_v);
    return uv_steps(context->screen, n, ahead, slice_normal_by_rises(context, p, sides, base, by_u, by_v), along_u,
                    along_v, anisotropy);
}
#endif

#if LIT
/* The base's normal below a point, interpolated */
INLINED Vector normal_below(global const float *normals, const SlicePoint *p)
{
    Vector of_corner[3];
    for (int k = 0; k < 3; k++)
        of_corner[k] = vector_at(normals, p->corner[k]);
    return normalized(mean_by_shares(p, of_corner));
}

/* The base's normal, tilted by the gradient of the heights over two texels */
INLINED Vector slice_normal_by_heights(const Context *context, const SlicePoint *p, const SliceSides *sides,
                                       Vector base)
{
    const float du = 1.0f / context->map_width, dv = 1.0f / context->map_height;
    const floatl by_u = (HEIGHT(p->u + du, p->v) - HEIGHT(p->u - du, p->v)) * (0.5f * context->map_width);
    const floatl by_v = (HEIGHT(p->u, p->v + dv) - HEIGHT(p->u, p->v - dv)) * (0.5f * context->map_height);
    return slice_normal_by_rises(context, p, sides, base, by_u, by_v);
}

/* The base's normal, tilted by a normal `own` from a map in tangent space, whose slopes are per scene unit */
INLINED Vector slice_normal_by_map(const Context *context, Vector base, intl triangle, Vector own)
{
    const Vector across = vector_at(context->frames, 3 * triangle + 1),
                 down = vector_at(context->frames, 3 * triangle + 2);
    const floatl steep = 1.0f / max_lanes(own.z, (floatl)1e-3f);
    return normalized(minus(base, combined(-own.x * steep, across, -own.y * steep, down)));
}

#if SHADOWED
/* Returns whether a point lies more than a slice spacing below the map's height, and so may be on a side of the
 * volume. */
INLINED intl is_on_side(const Context *context, const SlicePoint *p, floatl h)
{
    return (HEIGHT(p->u, p->v) - h) * context->slices > 1.0f;
}

/* The normal of a side of the volume: at right angles to the base's normal, towards the viewer */
INLINED Vector side_normal(Vector base, Vector ahead)
{
    const floatl up = DOT(base, ahead);
    const Vector across = {up * base.x - ahead.x, up * base.y - ahead.y, up * base.z - ahead.z};
    return normalized(across);
}
#endif
#endif
#endif
