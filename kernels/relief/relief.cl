/* Relief mapping on a mesh, with true silhouettes and depth (Oliveira & Policarpo 2005).
 *
 * A pixel's ray enters the relief at the mesh. There the vertices' frames and quadrics are interpolated, and the ray is
 * followed in texture space (search.h) until it meets the relief, or comes out again at a silhouette. The ray may then
 * enter the relief elsewhere (layers.h).
 *
 * If the eye is below the mesh, within the relief, its rays have no entry. Then, with WITHIN, rays walk from the eye,
 * which is below `eye_triangle`, to where they leave the mesh.
 *
 * Deviations from the paper: safe steps (search.h). A ray that comes out of the relief above its quadric, but has not
 * left the mesh, is searched once more, with depths estimated from the mesh (layers.h). Gradients of u and v replace
 * tile sizes, because gradients are valid even where u and v are not at right angles. The normal follows the quadric.
 * On curved surfaces, the paper replaces the second search for shadows by the light's map; here the second search uses
 * the quadric at the entry of the pixel's ray.
 *
 * faces, projected, vertices: entry.h. list, starts: raster/bins.cl, with fronts, and with backs if quadrics are
 * curved. texels, bounds, levels: search.h. colors: lib/texture.h. normal_map: (normal_height, normal_width, 3) with
 * its mipmaps, if normal_width > 0. Both maps are read by lib/footprint.h. hidden_by, flat_base: shadows.h. counters:
 * (height, width, 2) searches and their steps, with COUNTERS. uvs, with UV_WRITTEN: (height, width, 2) u and v of the
 * visible relief, 0 to 1; the host fills it with NaN, because bins without triangles write nothing. Work-item: a
 * region (raster/region.h). Cost: O(list + pixels * layers * steps). Determinism: list order.
 */
#include "relief/layers.h"
#include "relief/shading_point.h"
#include "relief/shadows.h"

#ifndef UV_WRITTEN
#define UV_WRITTEN 0 /* 1: the place on the map that each pixel shows is written, too */
#endif

#if UV_WRITTEN
/* Writes the places on the map that a block's pixels show; NaN for other pixels. */
void write_uv(const Region *region, int block, Screen screen, global float *uvs)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, region->x + FIRST_X(block), region->y + FIRST_Y(block), lane);
        const float2 uv = {float_lane(region->u[block], lane), float_lane(region->v[block], lane)};
        const float2 in_map = {CLAMPED_U ? clamp(uv.x, 0.0f, 1.0f) : uv.x - floor(uv.x),
                               CLAMPED_V ? clamp(uv.y, 0.0f, 1.0f) : uv.y - floor(uv.y)};
        if (at >= 0)
            vstore2(int_lane(region->owner[block], lane) >= 0 ? in_map : (float2)(NAN), at, uvs);
    }
}
#endif

#if WITHIN
#define EYE_PARAMETER , int eye_triangle, float eye_depth
#define EYE_ARGUMENT , eye_triangle, eye_depth
#else
#define EYE_PARAMETER
#define EYE_ARGUMENT
#endif

kernel void draw_relief(BINS_PARAMETERS, PICTURE_PARAMETERS, global const int *faces, global const float *vertices,
                        global const float *prisms, global const uint *texels, global const uint *bounds,
                        global const int *levels, int level_count,
                        global const uint *colors, int color_width, int color_height, int color_levels, float scale,
                        float pixel_size, int quadric, int search, int steps, int halvings ANISOTROPY_PARAMETER
#if LIT
                        ,
                        global const float *normal_map, int normal_width, int normal_height,
                        Light light SHADOW_PARAMETERS
#endif
#if SHADOWED
                        ,
                        int hidden_by, int flat_base
#endif
                        COUNTERS_PARAMETER(int)
                        EYE_PARAMETER
#if UV_WRITTEN
                        ,
                        global float *uvs
#endif
)
{
    Layers layers;
    const Picture picture = PICTURE_VALUE;
    const Relief relief = {faces, projected, vertices, prisms, texels, bounds, levels, level_count, screen,
                           scale, pixel_size, quadric, search, steps, halvings};
    const Context context = {relief, nearest_w, CULLS_BACKS, &layers, COUNTERS_ARGUMENT(int) EYE_ARGUMENT};
    Region region;
    BinList listed;
#if WITHIN /* rays start everywhere, not only at triangles */
    const int first_x = get_global_id(0) * REGION, first_y = get_global_id(1) * REGION;
    if (first_x >= screen.width || first_y >= screen.height)
        return;
    list_of_bin(list, starts, bins_x, first_x, first_y, &listed);
    begin_in_picture(&region, &picture, first_x, first_y);
#else
    if (!begin_item(&region, &picture, list, starts, bins_x, &listed))
        return;
#endif
    search_layers(&context, &region, listed);

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        Color shade = {0.0f, 0.0f, 0.0f};
        if (!DEPTH_ALONE && any_lane(mine)) {
            const floatl u = select_lanes(mine, region.u[block], (floatl)0.0f),
                         v = select_lanes(mine, region.v[block], (floatl)0.0f);
            const floatl px = BLOCK_X(&region, block), py = BLOCK_Y(&region, block), n = region.nearness[block];
            const Entry e = entry_of_hit(&relief, &layers, block, select_lanes(mine, owner, (intl)0), px, py);
            const floatl size = PIXEL_SIZE(&relief, n);
#if LIT || ANISOTROPIC
            const floatl t = select_lanes(mine, layers.t[block], (floatl)0.0f);
            const ShadingPoint shading = shading_point_at(&relief, &e, px, py, n, u, v, t, mine);
#endif
#if ANISOTROPIC
            const UvSteps over = relief_uv_steps(&relief, &e, &shading, n, anisotropy);
            const Footprint f = footprint_of(over, color_width, color_height, mine);
#else
            const Footprint f = isotropic_footprint(texels_of(&e, color_width, color_height, size, mine));
#endif
            add_footprint(colors, u, v, f, level_of_texels(f.texels_2, color_levels), color_width, color_height,
                          1.0f / 255.0f, &shade);
#if LIT
            /* Shadows use the normal from the heights, not from the normal map. */
            const Vector own = relief_normal_by_slope(&relief, &e, &shading);
            Vector normal = own;
            if (normal_width > 0) {
#if ANISOTROPIC
                const Vector mapped = mean_normal(normal_map, normal_width, normal_height, shading.place.u,
                                                  shading.place.v, over, mine);
#else
                const Vector mapped = normal_in(normal_map, normal_width, normal_height, 0, shading.place.u,
                                                shading.place.v);
#endif
                normal = relief_normal_by_map(shading.normal, &e, mapped);
            }
            floatl visible = 1.0f;
#if SHADOWED
            const intl faces = mine & (DOT(normal, to_light(light, shading.point).direction) > 0.0f);
            visible = in_sight(&relief, &e, &shading, own, light, faces, hidden_by, flat_base SHADOW_ARGUMENTS);
#endif
            apply_light(&shade, light, shading.point, normal, shading.ahead, visible);
#endif
        }
#if UV_WRITTEN
        write_uv(&region, block, screen, uvs);
#endif
        write_block(&region, block, &picture, shade);
    }
}
