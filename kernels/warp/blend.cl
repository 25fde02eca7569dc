/* The pictures of several views, the layers, blended: of the layers that show a pixel's nearest surface, each weighs
 * the more the better its view saw it.
 *
 * A layer contributes where it lies no farther behind the nearest one than the noise of both explains. Its weight is
 * the product of
 * - resolution: its view's samples per pixel, up to one: finer than the picture is as good as the picture;
 * - angle: the cosine between its view's ray and the picture's, as surfaces look different from elsewhere;
 * - distance to edges: it fades within FEATHER pixels of its holes and depth edges, so that seams follow these and
 *   colours that are half of another surface count least.
 * (The weights are of the kind that Pajarola, Sainz & Meng 2003, section 4, blend depth meshes by.)
 *
 * Launches: nearest_layer for each layer; then for each mark_edges, row_distances, add_layer; then write_blend, once.
 * depth, color, valid: (height, width) of a layer, or of the picture. best: (2, height, width) depth of the nearest
 * layer, and by how much it may be off. sums: (6, height, width) the weights' sum; the weighted means of red, green,
 * blue and depth so far, which are a layer's own to the bit where it contributes alone; the greatest weight; with
 * GBUFFER 2, three more, of the normal.
 * from_edge: (height + 2 FEATHER, pitch) with a margin of FEATHER pixels to each side.
 * Work-item: LANES pixels of a row. Cost: O(pixels) a layer. Determinism: layers are added in the order of the views.
 */
#include "lib/color.h"
#include "lib/gbuffer.h"
#include "lib/screen.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: the origins of the layer of the greatest weight are kept, too */
#endif
#define FEATHER 8                /* pixels */
#define EDGE_STEP 0.05f          /* of the depth: neighbours that differ by more are two surfaces */
#define TOLERANCE_MIN 0.02f      /* of the depth: layers that differ by less show one surface, whatever the noise */
#define LAYER_DEVIATIONS 4.0f    /* standard deviations of the noise, which explain a difference */
#define WEIGHT_MIN 1e-6f         /* of a layer that contributes at all */

/* A view's sampling: pixels a unit of what is at depth 1 (perspective) or anywhere, and its noise at depth z, whose
 * standard deviation is noise_2 z z + noise_1 z + noise_0. unit: a depth where none has an origin, or 0. */
typedef struct {
    float forward[3], centre[3]; /* relative to the screen's origin */
    float density;               /* fx * fy */
    int perspective;
    float noise_2, noise_1, noise_0;
    float unit;
} LayerView;

INLINED floatl depth_tolerance(LayerView layer_view, floatl z)
{
    const floatl noise = LAYER_DEVIATIONS * ((layer_view.noise_2 * z + layer_view.noise_1) * z + layer_view.noise_0);
    return max_lanes(noise, layer_view.unit > 0.0f ? (floatl)(TOLERANCE_MIN * layer_view.unit) : TOLERANCE_MIN * z);
}

INLINED floatl pixels_at(global const float *image, int x0, int y, int width)
{
    const intl x = min(x0 + lane_index, (intl)(width - 1));
    return (floatl)(gather(image, y * width + x));
}

kernel void nearest_layer(global const float *depth, global float *best, int width, int height, int first,
                          LayerView layer_view)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    const floatl z = pixels_at(depth, x0, y, width), off = depth_tolerance(layer_view, z);
    for (int lane = 0; lane < min(LANES, width - x0); lane++) {
        const size_t at = (size_t)y * width + x0 + lane, plane = (size_t)height * width;
        const float own = float_lane(z, lane);
        if (first || own < best[at] || !(best[at] == best[at])) {
            best[at] = own;
            best[at + plane] = float_lane(off, lane);
        }
    }
}

/* 0 on holes and at depth edges, FEATHER elsewhere and beyond the picture, which ends no surface */
kernel void mark_edges(global const float *depth, global float *from_edge, int width, int height, int pitch,
                       LayerView layer_view)
{
    const int x0 = get_global_id(0) * LANES, row = get_global_id(1);
    if (x0 >= width + 2 * FEATHER || row >= height + 2 * FEATHER)
        return;
    const int y = clamp(row - FEATHER, 0, height - 1);
    const intl x = min(max(x0 + lane_index - FEATHER, (intl)0), (intl)(width - 1));
    const floatl z = (floatl)(gather(depth, y * width + x));
    const floatl step = max_lanes(2.0f * depth_tolerance(layer_view, z),
                                  layer_view.unit > 0.0f ? (floatl)(EDGE_STEP * layer_view.unit) : EDGE_STEP * z);
    const intl left = y * width + max(x - 1, (intl)0), right = y * width + min(x + 1, (intl)(width - 1));
    const intl above = max(y - 1, 0) * width + x, under = min(y + 1, height - 1) * width + x;
    const floatl a = (floatl)(gather(depth, left)), b = (floatl)(gather(depth, right));
    const floatl c = (floatl)(gather(depth, above)), d = (floatl)(gather(depth, under));
    /* Comparisons with NaN, a hole, are false. */
    const intl whole = (fabs(a - z) <= step) & (fabs(b - z) <= step) & (fabs(c - z) <= step) & (fabs(d - z) <= step);
    const intl beyond = (x0 + lane_index < FEATHER) | (x0 + lane_index >= width + FEATHER) |
                        (intl)(row < FEATHER || row >= height + FEATHER ? -1 : 0);
    store_lanes(select_lanes(whole | beyond, (floatl)FEATHER, (floatl)0.0f), from_edge + (size_t)row * pitch + x0);
}

/* Distances to edges of the same row. Both arrays as from_edge; columns begin at the picture's first. */
kernel void row_distances(global const float *from_edge, global float *in_row, int width, int height, int pitch)
{
    const int x0 = get_global_id(0) * LANES, row = get_global_id(1);
    if (x0 >= width || row >= height + 2 * FEATHER)
        return;
    global const float *here = from_edge + (size_t)row * pitch + x0 + FEATHER;
    floatl least = load_lanes(here);
    for (int step = 1; step <= FEATHER; step++)
        least = min_lanes(least, min_lanes(load_lanes(here - step), load_lanes(here + step)) + step);
    store_lanes(least, in_row + (size_t)row * pitch + x0);
}

/* The layer's weight at points p of the picture, but for its edges */
INLINED floatl view_weight(LayerView layer_view, Screen screen, Vector p, floatl z, float density)
{
    const Vector centre = {layer_view.centre[0], layer_view.centre[1], layer_view.centre[2]};
    const Vector forward = {layer_view.forward[0], layer_view.forward[1], layer_view.forward[2]};
    const Vector direction = minus(p, centre);
    const floatl deep = DOT(direction, forward);
    const floatl there = layer_view.perspective ? layer_view.density / (deep * deep) : (floatl)layer_view.density;
    const floatl here = screen.perspective ? density / (z * z) : (floatl)density;
    const floatl cosine = DOT(layer_view.perspective ? normalized(direction) : forward, view_direction(screen, p));
    return min_lanes(there / here, (floatl)1.0f) * max_lanes(cosine, (floatl)WEIGHT_MIN);
}

kernel void add_layer(global const float *depth, global const channel *color, global const float *best,
                      global const float *in_row, global float *sums, Screen screen, LayerView layer_view,
                      float density, int pitch, int first, float red, float green, float blue
#if ORIGINS
                      ,
                      global const float *layer_origin,
                      global float *origin
#endif
                          NORMALS_PARAMETER(float) /* of the layer, in the world, of any length */
)
{
    const int width = screen.width, height = screen.height;
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    floatl edge = FEATHER;
    for (int step = -FEATHER; step <= FEATHER; step++)
        edge = min_lanes(edge,
                         max_lanes(load_lanes(in_row + (size_t)(y + FEATHER + step) * pitch + x0), (floatl)abs(step)));
    const size_t plane = (size_t)height * width;
    const floatl z = pixels_at(depth, x0, y, width), nearest = pixels_at(best, x0, y, width);
    const floatl off = depth_tolerance(layer_view, z), off_best = pixels_at(best + plane, x0, y, width);
    const floatl allowed = sqrt(0.5f * (off * off + off_best * off_best));
    const intl contributes = (z - nearest <= allowed) & (z == z);
    const floatl z_there = select_lanes(contributes, z, (floatl)1.0f);
    const Vector p = point_at(screen, to_floatl(x0 + lane_index), (floatl)y, DEPTH_OF(screen.perspective, z_there));
    const floatl well = view_weight(layer_view, screen, p, z_there, density) * (edge + 0.25f) * (1.0f / FEATHER);
    const floatl weight = select_lanes(contributes, max_lanes(well, (floatl)WEIGHT_MIN), (floatl)0.0f);
    for (int lane = 0; lane < min(LANES, width - x0); lane++) {
        const size_t at = (size_t)y * width + x0 + lane;
        const float own = float_lane(weight, lane);
        const float total = own + (first ? 0.0f : sums[at]), share = own > 0.0f ? own / total : 0.0f;
        sums[at] = total;
        const float3 c = read_pixel(color + CHANNELS * at);
        const float parts[4] = {red * c.x, green * c.y, blue * c.z, float_lane(z_there, lane)};
        for (int i = 0; i < 4; i++) {
            global float *mean = sums + (i + 1) * plane + at;
            const float before = first ? 0.0f : *mean;
            *mean = before + (parts[i] - before) * share;
        }
#if GBUFFER == 2
        const float3 normal = own > 0.0f ? vload3(at, normals) : (float3)(0.0f);
        const float axes[3] = {normal.x, normal.y, normal.z};
        for (int i = 0; i < 3; i++) {
            global float *mean = sums + (i + 6) * plane + at;
            const float before = first ? 0.0f : *mean;
            *mean = before + (axes[i] - before) * share;
        }
#endif
        if (first || own > sums[5 * plane + at]) {
            sums[5 * plane + at] = own;
#if ORIGINS
            vstore3(vload3(at, layer_origin), at, origin);
#endif
        }
    }
}

/* Writes the blended pixels; merge: those alone that are nearer than what the picture shows. */
kernel void write_blend(global const float *sums, global float *depth, global channel *color, global uchar *valid,
                        int width, int height, int merge GBUFFER_PARAMETERS)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    const size_t plane = (size_t)height * width;
    for (int x = x0; x < min(x0 + LANES, width); x++) {
        const size_t at = (size_t)y * width + x;
        const int any = sums[at] > 0.0f;
        const float z = any ? sums[4 * plane + at] : NAN;
        if (merge && (!any || z >= depth[at]))
            continue;
        depth[at] = z;
        valid[at] = any;
        const float3 mean = (float3)(sums[plane + at], sums[2 * plane + at], sums[3 * plane + at]);
        write_pixel(color + CHANNELS * at, any ? clamp(rounded_channel(mean), 0.0f, CHANNEL_MAX) : (float3)(0.0f));
        const GBuffer gbuffer = GBUFFER_VALUE;
        float3 normal = 0.0f;
#if GBUFFER == 2
        normal = 0.5f + 0.5f * (float3)(sums[6 * plane + at], sums[7 * plane + at], sums[8 * plane + at]);
#endif
        enter_pixel(gbuffer, at, depth[at], normal);
    }
}
