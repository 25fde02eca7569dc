/* Draws triangle meshes with texture, vertex colours and light.
 *
 * Values are interpolated perspective-correctly: a corner's weight at a pixel is the opposite edge's function, divided
 * by the sum of the three functions. The texture is read bilinearly in the two mip levels closest to the size of the
 * pixel's footprint (Williams 1983); lib/footprint.h takes several samples along a footprint's longer side.
 *
 * faces: (triangles, 3) vertex indices. projected, list, starts: bins.cl. depth, color, valid: (height, width) the
 * picture; nearer pixels stay, and the first of equally near triangles is visible.
 * TEXTURED: uv (vertices, 2); texels: RGBA bytes, level by level from the largest, each half the size of the previous
 * one, rounded down. TINTED: tints (vertices, 3) in [0, 1]. LIT: normals (vertices, 3); fronts: (triangles,) -1 if the
 * normals point to the side from which the corners run clockwise, else 1. culled: see triangle.h.
 * Work-item: a region (region.h). Cost: O(list + pixels). Determinism: list order.
 */
#include "lib/color.h"
#include "lib/footprint.h"
#include "lib/light.h"
#include "raster/nearest.h"

#ifndef TEXTURED
#define TEXTURED 0 /* 1: the mesh has a texture */
#endif
#ifndef TINTED
#define TINTED 0 /* 1: the mesh has vertex colours */
#endif

/* The weighted mean of the corners' values at a pixel */
INLINED floatl mean_of(const OnTriangle *p, floatl first, floatl second, floatl third)
{
    return p->weight[0] * first + p->weight[1] * second + p->weight[2] * third;
}

INLINED Vector mean_vector(const OnTriangle *p, global const float *vectors)
{
    const Vector a = vector_at(vectors, p->corner[0]), b = vector_at(vectors, p->corner[1]),
                 c = vector_at(vectors, p->corner[2]);
    return plus_scaled(combined(p->weight[0], a, p->weight[1], b), p->weight[2], c);
}

#if TEXTURED
/* The texture's colours at the pixels, averaged over the pixels' footprints */
INLINED Color read_texture(const OnTriangle *p, global const float *uv, global const uint *texels, int width,
                           int height, int levels ANISOTROPY_PARAMETER)
{
    floatl cu[3], cv[3];
    UNROLLED
    for (int k = 0; k < 3; k++)
        gather_pairs(uv, 2 * p->corner[k], &cu[k], &cv[k]);
    const floatl u = mean_of(p, cu[0], cu[1], cu[2]), v = mean_of(p, cv[0], cv[1], cv[2]);
    /* From a pixel to the next along x, the function of the edge opposite to a corner changes by a, and the sum of the
     * three functions by a_sum; along y, by b and b_sum. */
    floatl du_x = 0.0f, dv_x = 0.0f, du_y = 0.0f, dv_y = 0.0f, a_sum = 0.0f, b_sum = 0.0f;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const floatl a = p->V[i] * p->W[j] - p->W[i] * p->V[j], b = p->W[i] * p->U[j] - p->U[i] * p->W[j];
        du_x += a * cu[k];
        dv_x += a * cv[k];
        du_y += b * cu[k];
        dv_y += b * cv[k];
        a_sum += a;
        b_sum += b;
    }
#if ANISOTROPIC
    const UvSteps over = {(du_x - u * a_sum) / p->area, (dv_x - v * a_sum) / p->area, (du_y - u * b_sum) / p->area,
                          (dv_y - v * b_sum) / p->area, anisotropy};
    const Footprint f = footprint_of(over, width, height, lane_index >= 0);
#else
    du_x = (du_x - u * a_sum) / p->area * width;
    dv_x = (dv_x - v * a_sum) / p->area * height;
    du_y = (du_y - u * b_sum) / p->area * width;
    dv_y = (dv_y - v * b_sum) / p->area * height;
    const Footprint f = isotropic_footprint(max_lanes(du_x * du_x + dv_x * dv_x, du_y * du_y + dv_y * dv_y));
#endif
    const floatl lod = fmin(fmax(0.5f * log2(f.texels_2), (floatl)0.0f), (floatl)(levels - 1));
    const floatl below = truncated(lod), between = lod - below;
    Color read = {0.0f, 0.0f, 0.0f};
    add_footprint(texels, u, v, f, to_intl(below), width, height, (1.0f - between) / 255.0f, &read);
    if (any_lane(between > 0.0f))
        add_footprint(texels, u, v, on_coarser(f), min(to_intl(below) + 1, (intl)(levels - 1)), width, height,
                      between / 255.0f, &read);
    return read;
}
#endif

#if SHADOWED
/* The normal of a triangle's plane, on the side from which its corners run counter-clockwise; not used for shading. */
INLINED Vector own_normal(const OnTriangle *p, global const float *vertices)
{
    Vector at[3];
    UNROLLED
    for (int k = 0; k < 3; k++)
        at[k] = vector_at(vertices, p->corner[k]);
    return normalized(cross_product(minus(at[1], at[0]), minus(at[2], at[0])));
}
#endif

kernel void draw_mesh(BINS_PARAMETERS, PICTURE_PARAMETERS, global const int *faces, int culled, float base_r,
                      float base_g, float base_b
#if TEXTURED
                      ,
                      global const float *uv, global const uint *texels, int texture_width, int texture_height,
                      int levels ANISOTROPY_PARAMETER
#endif
#if TINTED
                      ,
                      global const float *tints
#endif
#if LIT
                      ,
                      global const float *normals, global const short *fronts, Light light SHADOW_PARAMETERS
#endif
#if SHADOWED
                      ,
                      global const float *vertices /* (vertices, 3) world */
#endif
)
{
    const Picture picture = PICTURE_VALUE;
    const Context context = {faces, projected, screen, nearest_w, culled};
    Region region;
    BinList listed;
    if (!begin_item(&region, &picture, list, starts, bins_x, &listed))
        return;
    draw_list(&context, &region, listed);

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        Color shade = {base_r, base_g, base_b};
        if (any_lane(mine)) {
            const floatl px = BLOCK_X(&region, block), py = BLOCK_Y(&region, block);
            const intl face = select_lanes(mine, owner, (intl)0);
            const OnTriangle p = on_triangle(faces, projected, face, px, py);
#if TINTED
            const Vector tint = mean_vector(&p, tints);
            shade.r = tint.x, shade.g = tint.y, shade.b = tint.z;
#endif
#if TEXTURED
            shade = read_texture(&p, uv, texels, texture_width, texture_height, levels ANISOTROPY);
#endif
#if LIT
            const floatl flip = select_lanes(p.area > 0.0f, (floatl)-1.0f, (floatl)1.0f),
                         front = (floatl)(gather(fronts, face));
            const Vector normal = mean_vector(&p, normals), point = point_at(screen, px, py, region.nearness[block]);
            floatl visible = 1.0f;
#if SHADOWED
            visible = VISIBILITY(point, scaled(own_normal(&p, vertices), flip));
#endif
            apply_light(&shade, light, point, scaled(normal, flip * front / sqrt(DOT(normal, normal))),
                        view_direction(screen, point), visible);
#endif
        }
        write_block(&region, block, &picture, shade);
    }
}
