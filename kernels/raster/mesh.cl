/* Triangle meshes: texture, vertex colours, light.
 *
 * Perspective-correct: a corner's weight at a pixel is its opposite edge's function over the sum of all three. The
 * texture is read bilinearly in the two levels of its pyramid around the pixel's footprint (Williams 1983).
 *
 * faces: (triangles, 3) corners of each. projected: (vertices, 4), project.cl. list, starts: bins.cl. depth, color,
 * valid: (height, width) the picture, which keeps what is nearer already; ties go to the first triangle.
 * TEXTURED: uv (vertices, 2); texels: RGBA bytes, level by level from the largest, each half the size of the one
 * before, rounded down. TINTED: tints (vertices, 3) in [0, 1]. LIT: normals (vertices, 3); fronts: (triangles,)
 * 1, or -1 where they point to the side that the corners run clockwise on. culled: triangle.h.
 * Work-item: a region (region.h). Cost: O(list + pixels). Determinism: list order.
 */
#include "lib/color.h"
#include "lib/light.h"
#include "lib/texture.h"
#include "raster/nearest.h"

#define GATHER(array, i) gather(array, (i))

/* The mean of the corners' values: one of `stride` numbers a vertex */
floatl mean_on(const Place *p, global const float *values, int stride, int part)
{
    return p->weight[0] * (floatl)(GATHER(values, p->corner[0] * stride + part)) +
           p->weight[1] * (floatl)(GATHER(values, p->corner[1] * stride + part)) +
           p->weight[2] * (floatl)(GATHER(values, p->corner[2] * stride + part));
}

kernel void draw_mesh(global const int *faces, global const float *projected, global const int *list,
                      global const int *starts, int bins_x, global float *depth, global channel *color,
                      global uchar *valid, Screen screen, float nearest_w, int culled, int blank, float base_r,
                      float base_g, float base_b
#ifdef TEXTURED
                      ,
                      global const float *uv, global const uint *texels, int texture_width, int texture_height,
                      int levels
#endif
#ifdef TINTED
                      ,
                      global const float *tints
#endif
#ifdef LIT
                      ,
                      global const float *normals, global const short *fronts, Light light SHADOW_PARAMETERS
#endif
#ifdef SHADOWED
                      ,
                      global const float *vertices /* (vertices, 3) world */
#endif
)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= screen.width || y >= screen.height)
        return;
    const Context context = {faces, projected, screen, nearest_w, culled};
    const int bin = y / BIN * bins_x + x / BIN;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);
    draw_list(&context, &region, list, starts[bin], starts[bin + 1], x, y);

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        Color shade = {base_r, base_g, base_b};
        const int first_x = block % ROW * BLOCK, first_y = block / ROW * BLOCK;
        if (any_lane(mine)) {
            const floatl px = to_floatl(x + first_x + block_x), py = to_floatl(y + first_y + block_y);
            const intl face = pick(mine, owner, (intl)0);
            const Place p = place_on(faces, projected, face, px, py);
#ifdef TINTED
            shade.r = mean_on(&p, tints, 3, 0);
            shade.g = mean_on(&p, tints, 3, 1);
            shade.b = mean_on(&p, tints, 3, 2);
#endif
#ifdef TEXTURED
            const floatl u = mean_on(&p, uv, 2, 0), v = mean_on(&p, uv, 2, 1);
            /* One pixel on, weights change by the edges' a or b, and the total by their sums. */
            floatl du_x = 0.0f, dv_x = 0.0f, du_y = 0.0f, dv_y = 0.0f, a_sum = 0.0f, b_sum = 0.0f;
            for (int k = 0; k < 3; k++) {
                const int i = (k + 1) % 3, j = (k + 2) % 3;
                const floatl a = p.V[i] * p.W[j] - p.W[i] * p.V[j], b = p.W[i] * p.U[j] - p.U[i] * p.W[j];
                const floatl cu = (floatl)(GATHER(uv, 2 * p.corner[k])), cv = (floatl)(GATHER(uv, 2 * p.corner[k] + 1));
                du_x += a * cu;
                dv_x += a * cv;
                du_y += b * cu;
                dv_y += b * cv;
                a_sum += a;
                b_sum += b;
            }
            du_x = (du_x - u * a_sum) / p.area * texture_width;
            dv_x = (dv_x - v * a_sum) / p.area * texture_height;
            du_y = (du_y - u * b_sum) / p.area * texture_width;
            dv_y = (dv_y - v * b_sum) / p.area * texture_height;
            const floatl texels_2 = greater(du_x * du_x + dv_x * dv_x, du_y * du_y + dv_y * dv_y);
            const floatl lod = fmin(fmax(0.5f * log2(texels_2), (floatl)0.0f), (floatl)(levels - 1));
            const floatl below = truncated(lod), between = lod - below;
            Color read = {0.0f, 0.0f, 0.0f};
            add_level(texels, u, v, to_intl(below), texture_width, texture_height, (1.0f - between) / 255.0f, &read);
            if (any_lane(between > 0.0f))
                add_level(texels, u, v, min(to_intl(below) + 1, (intl)(levels - 1)), texture_width, texture_height,
                          between / 255.0f, &read);
            shade = read;
#endif
#ifdef LIT
            floatl nx = mean_on(&p, normals, 3, 0), ny = mean_on(&p, normals, 3, 1), nz = mean_on(&p, normals, 3, 2);
            const floatl n = region.nearness[block], flip = pick(p.area > 0.0f, (floatl)-1.0f, (floatl)1.0f);
            const floatl front = (floatl)(gather(fronts, face)), scale = flip * front / sqrt(nx * nx + ny * ny + nz * nz);
            const float *m = screen.to_world;
            const floatl inverse = 1.0f / (PIXEL_ROW(m, 3, px, py) + n * m[15]);
            const floatl X = (PIXEL_ROW(m, 0, px, py) + n * m[3]) * inverse, Y = (PIXEL_ROW(m, 1, px, py) + n * m[7]) * inverse,
                         Z = (PIXEL_ROW(m, 2, px, py) + n * m[11]) * inverse;
            nx *= scale;
            ny *= scale;
            nz *= scale;
            const Direction ahead = towards(screen, X, Y, Z);
            floatl visible = 1.0f;
#ifdef SHADOWED /* by the triangle's own normal: the one that is shaded by may be bent */
            floatl side[6];
            for (int part = 0; part < 3; part++) {
                const floatl start = (floatl)(GATHER(vertices, 3 * p.corner[0] + part));
                side[part] = (floatl)(GATHER(vertices, 3 * p.corner[1] + part)) - start;
                side[3 + part] = (floatl)(GATHER(vertices, 3 * p.corner[2] + part)) - start;
            }
            const floatl gx = side[1] * side[5] - side[2] * side[4], gy = side[2] * side[3] - side[0] * side[5];
            const floatl gz = side[0] * side[4] - side[1] * side[3];
            const floatl unit = flip / sqrt(greater(gx * gx + gy * gy + gz * gz, (floatl)1e-30f));
            visible = VISIBILITY(X, Y, Z, gx * unit, gy * unit, gz * unit);
#endif
            shine(&shade, light, X, Y, Z, nx, ny, nz, -ahead.x, -ahead.y, -ahead.z, visible);
#endif
        }
        write_block(&region, block, screen, depth, color, valid, blank, x + first_x, y + first_y, shade);
    }
}
