/* Depth meshes of several views, blended per pixel (Pajarola, Sainz & Meng 2003, sections 4.3 to 4.5).
 *
 * The depth pass (mesh_layers.h) finds the nearest surface of each mesh at the pixels of a region. In the colour pass,
 * a pixel's colour is the weighted mean over the meshes whose surface lies at most epsilon behind the nearest one.
 * Where the drawn views have holes, the coarser meshes of the other views show. Surface that no view saw, but that must
 * be there, is closed (closing.h). A view's weight falls towards the ends of its surface, where the other views have
 * the whole weight. BLEND_QUALITY: positional weights times quality (select.cl), per pixel (as in the paper);
 * BLEND_POSITION: positional weights alone; BLEND_NEAREST: the colour of the nearest mesh.
 *
 * Deviations from the paper: Weights fall at a surface's ends. Only the nearest surface of each mesh is blended, so
 * other surfaces of this mesh add nothing, even within epsilon. Textures are projected, not stretched over triangles,
 * and are read within triangles of the view's samples, so no colour leaks over a depth edge. Triangles of coarse meshes
 * that bridge two surfaces are drawn only if holes are closed BY_SHEETS; else they mark rays that pass between
 * surfaces.
 *
 * corners, projected, points: select.cl, mesh by mesh in the order of `MeshCounts`. list, starts: raster/bins.cl.
 * firsts: (meshes + 1,) first triangle of each mesh. In the arrays below, `meshes` is others + views. sources: (meshes,
 * 4) index of the mesh's view, indices in `levels` of this view's finest and coarsest level, and 1 for a perspective
 * view. levels: (levels, 3) width, height and start in colors; each level is half as large as the previous one, rounded
 * up. scales: (meshes,) samples of the view per pixel of the target, at depth 1 in both. colors: RGBA bytes; A is 255
 * times the weight of a sample (feather_at) on a view's finest level, and 255 times the fraction of valid samples on
 * coarser levels. weights: (meshes,) positional weights, > 0. culled: raster/triangle.h. by: BLEND_... layer_nearness,
 * layer_owner: (others + views, items, pixels of a region) output of mesh_layers.h. With CLOSED BY_RAYS, the arrays of
 * FreeSpace (closing.h) for all `view_count` views; view_sizes is its `sizes`. depth, color, valid: the picture; pixels
 * that are nearer stay. occupancy, with OCCUPIED: (height, width) bit k is set where view k gave colour. guesses, with
 * GUESSES: (height, width) the depth of closed pixels. Work-item: every `items`-th region (raster/region.h). Cost:
 * O(list + pixels * meshes). Determinism: the order of the list, then of the meshes.
 */
#include "depthmesh/closing.h"
#include "depthmesh/mesh_layers.h"
#include "lib/color.h"
#include "lib/taps.h"
#include "raster/nearest.h"

#define BLEND_QUALITY 0
#define BLEND_POSITION 1
#define BLEND_NEAREST 2
#ifndef OCCUPIED
#define OCCUPIED 0 /* 1: also write the views that gave each pixel its colour */
#endif
#ifndef GUESSES
#define GUESSES 0 /* 1: also write the depth of closed pixels */
#endif
#define LEVEL_BIAS 0.25f /* in levels, added before rounding down: blur is worse than a little aliasing */
#define FACTOR_MIN 1e-3f /* least quality and least feather_at(): > 0, so that each surface gets a colour */

/* Adds the colour at the pixel (x, y) of a view, read from one of the view's levels. The finest level is interpolated
 * in the triangle that contains the pixel, coarser levels bilinearly, with texels weighted by their fraction of valid
 * samples. */
void add_sample(global const uint *colors, global const int *size, int level, floatl x, floatl y, floatl weight,
                Color *sum)
{
    const int width = size[0], height = size[1];
    const float per_texel = 1.0f / (1 << level);
    const floatl u = (x + 0.5f) * per_texel - 0.5f, v = (y + 0.5f) * per_texel - 0.5f, none = 0.0f;
    const Taps taps = clamped_taps(width, height, u, v);
    const floatl fx = taps.fx, fy = taps.fy, gx = 1.0f - fx, gy = 1.0f - fy;
    floatl share[4];
    tap_weights(taps.fx, taps.fy, share);
    if (level == 0) {
        /* Does the diagonal run to the lower right (depthmesh/tree.h)? */
        const intl main = ((taps.column ^ taps.row) & 1) == 0;
        share[0] = select_lanes(main, min_lanes(gx, gy), max_lanes(gx - fy, none));
        share[1] = select_lanes(main, max_lanes(fx - fy, none), min_lanes(fx, gy));
        share[2] = select_lanes(main, max_lanes(fy - fx, none), min_lanes(gx, fy));
        share[3] = select_lanes(main, min_lanes(fx, fy), max_lanes(fx - gy, none));
    }
    Color read = {0.0f, 0.0f, 0.0f};
    floatl opaque = 0.0f;
    for (int k = 0; k < 4; k++) {
        const intl word = texels_at(colors, size[2] + taps.at[k]);
        const intl alpha = word >> 24 & 255;
        const floatl part = share[k] * to_floatl(level == 0 ? min(alpha, (intl)1) : alpha);
        add_color(&read, part, color_of(word));
        opaque += part;
    }
    add_color(sum, weight / max_lanes(opaque, (floatl)1e-6f), read);
}

/* The weight of a view's samples at its pixel (x, y), 0 to 1: low at the ends of surfaces. size: row of the view's
 * finest level in `levels` */
floatl feather_at(global const uint *colors, global const int *size, floatl x, floatl y)
{
    const Taps taps = clamped_taps(size[0], size[1], x, y);
    floatl alpha[4];
    UNROLLED
    for (int k = 0; k < 4; k++)
        alpha[k] = to_floatl(texels_at(colors, size[2] + taps.at[k]) >> 24 & 255);
    return bilinear(taps, alpha[0], alpha[1], alpha[2], alpha[3]) * (1.0f / 255);
}

/* The meshes' colours and their weights; the arrays are described at the top */
typedef struct {
    int by; /* BLEND_... */
    global const int *firsts, *sources, *levels;
    global const float *points, *scales, *weights;
    global const uint *colors, *normals; /* normals with GBUFFER 2 */
} Meshes;

/* Weighted sums of colours and normals, and sums of weights. Weights of normals do not fall at the ends of surfaces:
 * surfaces with fine detail have many ends, and a mean over fewer views is less accurate. */
typedef struct {
    Color color, normal;
    floatl weight, normal_weight;
} MeshBlend;

/* Adds a mesh's weighted colours and normals to the `given` pixels (px, py). n, owner: nearness and triangle of the
 * mesh at the pixels. shares: pixels where the mesh is near enough to be blended, given or not */
INLINED void add_mesh(const Context *context, const Meshes *meshes, int mesh, floatl n, intl owner, floatl px,
                      floatl py, intl shares, intl given, MeshBlend *blend)
{
    const intl triangle = select_lanes(shares, owner, meshes->firsts[mesh] + (intl)0);
    const OnTriangle p = on_triangle(context->corners, context->projected, triangle, px, py);
    floatl at_x = 0.0f, at_y = 0.0f, at_z = 0.0f, quality = 0.0f;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        floatl at[4];
        gather_rows(meshes->points, p.corner[k], at);
        at_x += p.weight[k] * at[0];
        at_y += p.weight[k] * at[1];
        at_z += p.weight[k] * at[2];
        quality += p.weight[k] * at[3];
    }
    global const int *source = meshes->sources + 4 * mesh;
    const floatl inverse = source[3] ? 1.0f / at_z : (floatl)1.0f;
    const floatl sound_x = select_lanes(shares, at_x * inverse, (floatl)0.0f),
                 sound_y = select_lanes(shares, at_y * inverse, (floatl)0.0f);
    global const int *finest = meshes->levels + 3 * source[1];
    const floatl least = FACTOR_MIN, facing = meshes->by == BLEND_QUALITY ? max_lanes(quality, least) : (floatl)1.0f;
    const floatl feather = max_lanes(feather_at(meshes->colors, finest, sound_x, sound_y), least);
    const floatl unfaded = select_lanes(given, meshes->weights[mesh] * facing, (floatl)0.0f);
    const floatl weight = unfaded * feather;
    /* All pixels of the block read the same level, which is fine enough for each of them. */
    const floatl away = context->screen.perspective ? 1.0f / n : (floatl)1.0f;
    const float samples = least_lane(select_lanes(shares, meshes->scales[mesh] * away * inverse, (floatl)INFINITY));
    const int level = (int)fmin(floor(log2(fmax(samples, 1.0f)) + LEVEL_BIAS), (float)(source[2] - source[1]));
    add_sample(meshes->colors, finest + 3 * level, level, sound_x, sound_y, weight, &blend->color);
#if GBUFFER == 2
    add_sample(meshes->normals, finest + 3 * level, level, sound_x, sound_y, unfaded, &blend->normal);
#endif
    blend->weight += weight;
    blend->normal_weight += unfaded;
}

#if CLOSED == BY_RAYS
#if GBUFFER == 2
#define FAR_NORMALS_PARAMETER , global const uint *far_normals /* as far_colors */
#define FAR_NORMALS_ARGUMENT far_normals
#else
#define FAR_NORMALS_PARAMETER
#define FAR_NORMALS_ARGUMENT 0
#endif
/* Adds the weighted colours and normals of closed surface, which lies at nearness n, to the `given` pixels (x, y). */
INLINED void add_closing(const FreeSpace *space, const Meshes *meshes, global const uint *far_normals, floatl x,
                         floatl y, floatl n, intl given, MeshBlend *blend, intl *views)
{
#if GBUFFER == 2
    FreeSpace of_normals = *space;
    of_normals.far_colors = far_normals;
    blend->normal_weight +=
        add_closest(&of_normals, meshes->normals, meshes->levels, x, y, n, given, &blend->normal, views);
#endif
    blend->weight += add_closest(space, meshes->colors, meshes->levels, x, y, n, given, &blend->color, views);
}
#else
#define FAR_NORMALS_PARAMETER
#endif

#if OCCUPIED
/* Writes which views gave colour to each pixel of a block: bit k for view k. */
void write_occupancy(intl views, const Region *region, int block, Screen screen, global uint *occupancy)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, region->x + FIRST_X(block), region->y + FIRST_Y(block), lane);
        if (at >= 0)
            occupancy[at] = int_lane(views, lane);
    }
}
#endif

#if GUESSES
/* Writes the depths of the `written` pixels of a block: pixels that show closed surface. */
void write_guesses(intl written, const Region *region, int block, const Picture *picture, global float *guesses)
{
    if (!any_lane(written))
        return;
    for (int lane = 0; lane < LANES; lane++)
        if (int_lane(written, lane)) {
            const long at = pixel_of(picture->screen, region->x + FIRST_X(block), region->y + FIRST_Y(block), lane);
            if (at >= 0)
                guesses[at] = picture->depth[at];
        }
}
#endif

kernel void draw_meshes(BINS_PARAMETERS, PICTURE_PARAMETERS, global const int *corners, global const float *points,
                        global const int *firsts, global const int *sources, global const int *levels,
                        global const float *scales, global const uint *colors, global const float *weights, int culled,
                        float epsilon, MeshCounts counts, int by, global float *layer_nearness, global int *layer_owner,
                        int items
#if CLOSED == BY_RAYS
                        ,
                        global const float *free_depths, global const float *extended_depths,
                        global const uint *far_colors, global const float *cell_free_depths,
                        global const float *cell_extended_depths, global const int *view_sizes,
                        global const float *from_target, global const int *perspectives, global const int *first_levels,
                        global const float *closeness, float stride, int view_count, int enclosed
#endif
#if OCCUPIED
                        ,
                        global uint *occupancy
#endif
#if GUESSES
                        ,
                        global float *guesses
#endif
                            GBUFFER_PARAMETERS NORMALS_PARAMETER(uint) FAR_NORMALS_PARAMETER)
{
    const int columns = (screen.width + REGION - 1) / REGION, rows = (screen.height + REGION - 1) / REGION;
    const Picture picture = PICTURE_VALUE;
    const Context context = {corners, projected, screen, nearest_w, culled};
    const int others = counts.others, meshes = others + counts.views;
    const Meshes colored = {by, firsts + counts.sheets + counts.backs, sources, levels, points, scales, weights, colors,
                            NORMALS_ARGUMENT(uint)};
    const GBuffer gbuffer = GBUFFER_VALUE;
    const int item = get_global_id(0), end = item < items ? columns * rows : 0; /* surplus work-items draw nothing */
    const size_t size = BLOCKS * LANES, own = item * size;
    const MeshLayers layers = {layer_nearness + own, layer_owner + own, items * size};
#if CLOSED == BY_RAYS
    const FreeSpace space = {free_depths, extended_depths, far_colors, cell_free_depths, cell_extended_depths,
                             view_sizes, from_target, perspectives, first_levels, closeness, stride,
                             screen.perspective, view_count, enclosed};
#endif
    for (int drawn = item; drawn < end; drawn += items) {
        const int x = drawn % columns * REGION, y = drawn / columns * REGION;
        BinList listed;
        list_of_bin(list, starts, bins_x, x, y, &listed);
        Region region;
        if (!begin_listed(&region, &picture, listed, x, y))
            continue;
        Fronts fronts;
        const int holed = draw_depths(&context, &layers, counts, listed, firsts, x, y, &fronts);
        for (int block = 0; block < BLOCKS; block++) {
            const floatl px = BLOCK_X(&region, block), py = BLOCK_Y(&region, block);
            floatl front = fronts.views[block];
            const intl hole = front == EMPTY; /* no mesh of a drawn view covers the pixel */
#if CLOSED
            if (holed)
                front = select_lanes(hole, fronts.others[block], front);
#endif
#if CLOSED == BY_SHEETS
            const intl closed = hole & (front > EMPTY);
#elif CLOSED == BY_RAYS
            const floatl back = fronts.backs[block], sheet = holed ? fronts.sheets[block] : (floatl)EMPTY;
            const intl closed = close_block(&space, screen.nearest, epsilon, px, py, back, sheet, &front);
#endif
            const intl mine = front > region.nearness[block];
            if (!blank && !any_lane(mine))
                continue;
            MeshBlend blend = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
            intl taken = (intl)0, views = (intl)0; /* pixels with a mesh's colour; bit k: view k gave colour */
            const floatl deepest = screen.perspective ? front / (1.0f + epsilon * front) : front - epsilon;
            for (int mesh = holed ? 0 : others; mesh < meshes; mesh++) {
                const size_t at = mesh * layers.next + LANES * block;
                const floatl n = load_lanes(layers.nearness + at);
                const intl owner = load_lanes(layers.owner + at);
                intl shares = (owner >= 0) & (mesh < others ? hole : !hole);
                shares = shares & (by == BLEND_NEAREST ? (n == front) & !taken : n >= deepest);
                taken = taken | shares;
                const intl given = shares & mine;
                if (!any_lane(given))
                    continue;
                add_mesh(&context, &colored, mesh, n, owner, px, py, shares, given, &blend);
                views |= select_lanes(given, (intl)(1 << sources[4 * mesh]), (intl)0);
            }
#if CLOSED == BY_RAYS
            const intl given = closed & mine;
            if (any_lane(given))
                add_closing(&space, &colored, FAR_NORMALS_ARGUMENT, px, py, front, given, &blend, &views);
#endif
            const floatl scale = 1.0f / (255.0f * select_lanes(mine, blend.weight, (floatl)1.0f));
            const floatl normal_scale = 1.0f / (255.0f * select_lanes(mine, blend.normal_weight, (floatl)1.0f));
            region.nearness[block] = front;
            region.owner[block] = select_lanes(mine, (intl)0, (intl)-1);
            const intl written = write_block(&region, block, &picture, color_times(blend.color, scale));
            enter_block(gbuffer, written, &region, block, &picture, color_times(blend.normal, normal_scale));
#if GUESSES
            write_guesses(written & closed, &region, block, &picture, guesses);
#endif
#if OCCUPIED
            write_occupancy(views, &region, block, screen, occupancy);
#endif
        }
    }
}
