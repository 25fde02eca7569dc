/* Blends the pictures of several views, the layers. At each pixel, the layers of the nearest surface are averaged. A
 * layer's weight is greater, the better its view saw the surface.
 *
 * A layer contributes if it lies no farther behind the nearest layer than the noise of both explains. At a step of its
 * view's surface (view_edges.h), a layer may show a rubber sheet: there it only counts if all layers show steps.
 * The weight is the product of
 * - resolution: the view's samples per pixel of the picture, at most 1, since more samples do not improve the pixel;
 * - angle between the view's ray and the picture's ray: an error of depth moves a colour aside in proportion to the
 *   angle's sine. The factor is the angle's cosine, divided by 1 + sine^2 / ANGLE_SQUARE, which is the variance of the
 *   colour's position in units of the variance at angle 0;
 * - distance to the view's edges (view_edges.cl): a view fades out towards its edges, so no seam is visible there, and
 *   colours at edges, which may mix two surfaces, count least.
 * (Pajarola, Sainz & Meng 2003, section 4, blend depth meshes with weights of this kind.)
 *
 * Launches: weigh_layer for each layer, once it is drawn; then blend_layers, once for each stack of layers. If there
 * are several stacks, nearest_layers first finds the nearest layer of all stacks; then layers are drawn again, unless
 * the stack still holds them.
 * depth, color, valid, source, source_view: (height, width) of a layer, or of the picture (resolve.cl). best: (2,
 * height, pitch) depth of the nearest layer, and its tolerance: negative if it was seen at a step, 0 without a layer.
 * stack: (layers, LAYER_PLANES, height, pitch) weight, negative if seen at a step, 0 in holes; depth; colour (a word
 * with 8 bits for each channel, or three planes); with ORIGINS two planes of origins; with GBUFFER 2 three planes of
 * normals. sums: (SUMS, height, pitch) over the layers added so far: sum of weights; weighted means of red, green, blue
 * and depth, which equal a layer's own values to the bit if no other layer contributes; with ORIGINS the greatest
 * weight and the origin in the layer that has it; with GBUFFER 2 the mean normal.
 * Work-item: STRIP * LANES pixels of a row. Cost: O(pixels) for each layer. Determinism: layers are added in the order
 * of the stack.
 */
#include "lib/color.h"
#include "lib/gbuffer.h"
#include "lib/screen.h"
#include "lib/taps.h"
#include "warp/layers.h"
#include "warp/view_edges.h"

#define ANGLE_SQUARE 0.03f    /* square of the sine of 10 degrees */
#define AT_SAMPLE 0.01f       /* pixels of the view: a place this close to a sample shows the sample alone */
#define AT_STEP 0.5f          /* a place is at a step if its interpolated byte (view_edges.cl) is at most this */
#define WEIGHT_MIN 1e-6f      /* least weight of a layer that contributes */

/* The values of a packet of pixels. at: the first pixel's index; count: the number of pixels from it to the row's
 * end */
INLINED floatl pixels_at(global const float *image, size_t at, int count)
{
    if (count >= LANES)
        return load_lanes(image + at);
    const intl inside = min((intl)lane_index, (intl)(count - 1));
    return (floatl)(gather(image + at, inside));
}

/* Reads two successive pairs of bytes for each lane. */
#if LANES == 16
#define WORD_FROM(l) ((global const Word *)(pairs + at.s##l))->bytes
#define WORDS_FROM(pairs, at)                                                                                  \
    (uint16)(WORD_FROM(0), WORD_FROM(1), WORD_FROM(2), WORD_FROM(3), WORD_FROM(4), WORD_FROM(5), WORD_FROM(6),  \
             WORD_FROM(7), WORD_FROM(8), WORD_FROM(9), WORD_FROM(a), WORD_FROM(b), WORD_FROM(c), WORD_FROM(d),  \
             WORD_FROM(e), WORD_FROM(f))
#else
#define WORDS_FROM(pairs, at) as_uint(vload2(0, (pairs) + (at)))
#endif
INLINED intl words_at(global const ushort *pairs, intl at)
{
    return as_intl(WORDS_FROM(pairs, at));
}

/* The view's weight at points p of the picture, without the factor for edges */
INLINED floatl view_weight(LayerView view, Screen screen, Vector p, floatl z, float density)
{
    const Vector centre = {view.centre[0], view.centre[1], view.centre[2]};
    const Vector forward = {view.forward[0], view.forward[1], view.forward[2]};
    const Vector direction = minus(p, centre);
    const floatl deep = DOT(direction, forward);
    const floatl finer = (screen.perspective ? z : (floatl)1.0f) / (view.perspective ? deep : (floatl)1.0f);
    /* A perspective picture's eye is the origin. The vectors' lengths cancel; dividing them by the depth only keeps
     * their squares in range. */
    const float *m = screen.to_world;
    const Vector along = {-m[3], -m[7], -m[11]};
    const floatl scale = screen.perspective ? 1.0f / z : (floatl)1.0f;
    const Vector from = view.perspective ? scaled(direction, scale) : forward;
    const Vector to = screen.perspective ? scaled(p, scale) : along;
    const floatl dot = DOT(from, to), square = dot * dot / (DOT(from, from) * DOT(to, to));
    const floatl aside = max_lanes(1.0f - square, (floatl)0.0f) * (1.0f / ANGLE_SQUARE);
    const floatl cosine = select_lanes(dot > 0.0f, sqrt(square), (floatl)0.0f);
    return min_lanes(view.density / density * (finer * finer), (floatl)1.0f) * cosine / (1.0f + aside);
}

/* The distance of a layer's pixels from its view's edges, as a byte of view_edges.cl; 0 at steps, and on margins, which
 * only extend the surface */
INLINED floatl edges_at(PixelMap map, global const ushort *edges, floatl x, floatl y, floatl n)
{
    const float *S = map.src_from_dst;
    const floatl inverse = 1.0f / MAP_ROW(S, 2, x, y, n);
    const floatl u = MAP_ROW(S, 0, x, y, n) * inverse, v = MAP_ROW(S, 1, x, y, n) * inverse;
    const Taps taps = clamped_taps(map.src_width, map.src_height, u, v);
    const intl word = words_at(edges, taps.at[0]); /* bytes: left above, left below, right above, right below */
    const floatl distance = bilinear(taps, to_floatl(word & DISTANCE_BITS), to_floatl((word >> 16) & DISTANCE_BITS),
                                     to_floatl((word >> 8) & 255), to_floatl((word >> 24) & 255));
    const floatl off_sample = min_lanes(taps.fx, 1.0f - taps.fx) + min_lanes(taps.fy, 1.0f - taps.fy);
    const intl open = word & select_lanes(taps.fx + taps.fy > 1.0f, (intl)UPPER_OPEN, (intl)LOWER_OPEN);
    return select_lanes((open != 0) & (off_sample > AT_SAMPLE), (floatl)0.0f, distance);
}

#if CHANNELS && COLOR_BYTES == 1
/* A packet's colours as words, whose highest bytes are undefined. count: the number of pixels to the row's end */
INLINED intl pixel_words(global const uchar *first, int count)
{
#if LANES == 16
    if (count >= LANES + 2) { /* the read goes four bytes beyond the packet */
#define FOUR_PIXELS(at) as_int4(((global const UnalignedBytes *)(first + 12 * at))->bytes.s0123345667899abc)
        return (int16)(FOUR_PIXELS(0), FOUR_PIXELS(1), FOUR_PIXELS(2), FOUR_PIXELS(3));
    }
#endif
    intl words = 0;
    for (int lane = 0; lane < min(count, LANES); lane++)
        set_int_lane(words, lane, first[3 * lane] | first[3 * lane + 1] << 8 | first[3 * lane + 2] << 16);
    return words;
}
#endif

kernel void weigh_layer(global const float *depth, global const channel *color, global const ushort *edges,
                        global float *stack, int layer, int pitch, PixelMap map, Screen screen, LayerView view,
                        float density
#if ORIGINS
                        , global const float *layer_source
#endif
                        NORMALS_PARAMETER(float) /* the layer's normals, in the world, of any length */
)
{
    const int width = screen.width, y = get_global_id(1), strip_x = get_global_id(0) * (STRIP * LANES);
    if (y >= screen.height)
        return;
    const size_t plane = (size_t)screen.height * pitch;
    for (int x0 = strip_x; x0 < min(strip_x + STRIP * LANES, width); x0 += LANES) {
        const size_t at = (size_t)y * width + x0, own = (size_t)y * pitch + x0;
        global float *out = stack + layer * LAYER_PLANES * plane + own;
        const intl x = x0 + lane_index;
        const intl in_rows = y >= view.low_y && y < view.high_y ? -1 : 0;
        const intl inside = (x >= view.low_x) & (x < min(view.high_x, width)) & in_rows;
        const floatl z = any_lane(inside) ? pixels_at(depth, at, width - x0) : (floatl)NAN;
        const intl known = inside & (z == z);
        if (!any_lane(known)) {
            store_lanes((floatl)0.0f, out);
            continue;
        }
        const floatl z_there = select_lanes(known, z, (floatl)1.0f), n = DEPTH_OF(screen.perspective, z_there);
        const floatl from_edges = edges_at(map, edges, to_floatl(x), (floatl)y, n);
        const Vector p = point_at(screen, to_floatl(x), (floatl)y, n);
        const floatl well = view_weight(view, screen, p, z_there, density) * from_edges * (1.0f / FAR_FROM_EDGES);
        const floatl weight = max_lanes(well, (floatl)WEIGHT_MIN);
        const floatl signed_weight = select_lanes(from_edges > AT_STEP, weight, -weight);
        store_lanes(select_lanes(known, signed_weight, (floatl)0.0f), out + WEIGHT * plane);
        store_lanes(z_there, out + DEPTH * plane);
        const intl pixel = y * width + min(x, (intl)(width - 1));
#if CHANNELS
#if COLOR_BYTES == 1
        store_lanes(as_floatl(pixel_words(color + CHANNELS * at, width - x0)), out + COLOR * plane);
#else
        const Color none = {0.0f, 0.0f, 0.0f}; /* pixels that a layer does not draw are undefined */
        const Color c = select_color(known, read_color(color, pixel, width * screen.height), none);
        store_lanes(c.r, out + COLOR * plane);
        store_lanes(c.g, out + (COLOR + 1) * plane);
        store_lanes(c.b, out + (COLOR + 2) * plane);
#endif
#endif
#if ORIGINS
        store_lanes((floatl)(gather(layer_source, 2 * pixel)), out + ORIGIN * plane);
        store_lanes((floatl)(gather(layer_source, 2 * pixel + 1)), out + (ORIGIN + 1) * plane);
#endif
#if GBUFFER == 2
        const Vector normal = vector_at(normals, pixel);
        store_lanes(normal.x, out + NORMAL * plane);
        store_lanes(normal.y, out + (NORMAL + 1) * plane);
        store_lanes(normal.z, out + (NORMAL + 2) * plane);
#endif
    }
}

/* The nearest of some layers, as stored in `best` */
typedef struct {
    floatl z, off;
} Nearest;

/* Updates `best` from all layers of the stack. Their order does not matter. stack: at the packet's first pixel */
INLINED void find_nearest(Nearest *best, global const float *stack, size_t plane, global const BlendedView *views,
                          int count, float unit)
{
    for (int number = 0; number < count; number++) {
        global const float *layer = stack + number * LAYER_PLANES * plane;
        const floatl weight = load_lanes(layer + WEIGHT * plane);
        if (!any_lane(weight != 0.0f))
            continue;
        const floatl z = load_lanes(layer + DEPTH * plane), off = depth_tolerance(views[number], unit, z);
        const intl sure = weight > 0.0f, sure_best = best->off > 0.0f, none = best->off == 0.0f;
        const intl nearer = (z < best->z) | ((z == best->z) & (off > fabs(best->off)));
        const intl better = (weight != 0.0f) & (none | (sure & !sure_best) | ((sure | !sure_best) & nearer));
        best->z = select_lanes(better, z, best->z);
        best->off = select_lanes(better, select_lanes(sure, off, -off), best->off);
    }
}

/* first: 1 for the first stack, when `best` is not set yet */
kernel void nearest_layers(global const float *stack, global float *best, global const BlendedView *views, int count,
                           int first, int pitch, float unit, int width, int height)
{
    const int y = get_global_id(1), strip_x = get_global_id(0) * (STRIP * LANES);
    if (y >= height)
        return;
    const size_t plane = (size_t)height * pitch;
    for (int x0 = strip_x; x0 < min(strip_x + STRIP * LANES, width); x0 += LANES) {
        const size_t own = (size_t)y * pitch + x0;
        Nearest nearest = {0.0f, 0.0f};
        if (!first) {
            nearest.z = load_lanes(best + own);
            nearest.off = load_lanes(best + plane + own);
        }
        find_nearest(&nearest, stack + own, plane, views, count, unit);
        store_lanes(nearest.z, best + own);
        store_lanes(nearest.off, best + plane + own);
    }
}

typedef struct {
    floatl total;
    Color color;
    floatl z;
#if ORIGINS
    floatl greatest, u, v, number;
#endif
#if GBUFFER == 2
    Vector normal;
#endif
} Blended;

#if ORIGINS
#define EACH_ORIGIN(F) F(greatest, GREATEST) F(u, GREATEST + 1) F(v, GREATEST + 2) F(number, GREATEST + 3)
#else
#define EACH_ORIGIN(F)
#endif
#if GBUFFER == 2
#define EACH_AXIS(F) F(normal.x, NORMAL_MEANS) F(normal.y, NORMAL_MEANS + 1) F(normal.z, NORMAL_MEANS + 2)
#else
#define EACH_AXIS(F)
#endif
#define EACH_SUM(F)                                                                                            \
    F(total, 0) F(color.r, MEANS) F(color.g, MEANS + 1) F(color.b, MEANS + 2) F(z, MEANS + 3)                      \
    EACH_ORIGIN(F) EACH_AXIS(F)

INLINED Color stacked_color(global const float *at, size_t plane)
{
#if CHANNELS == 0
    const Color none = {0.0f, 0.0f, 0.0f};
    return none;
#elif COLOR_BYTES == 1
    return color_of(as_intl(load_lanes(at)));
#else
    const Color c = {load_lanes(at), load_lanes(at + plane), load_lanes(at + 2 * plane)};
    return c;
#endif
}

#define APPROACH(mean, part) mean += ((part) - (mean)) * share;

INLINED void add_layer(Blended *sums, global const float *layer, size_t plane, BlendedView view, floatl z,
                       floatl weight)
{
    sums->total += weight;
    const floatl share = select_lanes(weight > 0.0f, weight / sums->total, (floatl)0.0f);
    const Color c = stacked_color(layer + COLOR * plane, plane);
    APPROACH(sums->color.r, view.red * c.r)
    APPROACH(sums->color.g, view.green * c.g)
    APPROACH(sums->color.b, view.blue * c.b)
    APPROACH(sums->z, z)
#if ORIGINS
    const intl greater = weight > sums->greatest;
    sums->greatest = select_lanes(greater, weight, sums->greatest);
    sums->u = select_lanes(greater, load_lanes(layer + ORIGIN * plane), sums->u);
    sums->v = select_lanes(greater, load_lanes(layer + (ORIGIN + 1) * plane), sums->v);
    sums->number = select_lanes(greater, (floatl)view.number, sums->number);
#endif
#if GBUFFER == 2
    const intl any = weight > 0.0f;
    APPROACH(sums->normal.x, select_lanes(any, load_lanes(layer + NORMAL * plane), sums->normal.x))
    APPROACH(sums->normal.y, select_lanes(any, load_lanes(layer + (NORMAL + 1) * plane), sums->normal.y))
    APPROACH(sums->normal.z, select_lanes(any, load_lanes(layer + (NORMAL + 2) * plane), sums->normal.z))
#endif
}

/* Writes the pixels of a packet, at most `count`; with `merge`, only where they are nearer than the picture. */
INLINED void write_blend(Blended sums, size_t at, int count, int merge, global float *depth, global channel *color,
                         global uchar *valid
#if ORIGINS
                         , global float *source, global int *source_view
#endif
                         , GBuffer gbuffer)
{
    const intl any = sums.total > 0.0f;
    const floatl z = select_lanes(any, sums.z, (floatl)NAN);
    const Color none = {0.0f, 0.0f, 0.0f};
    const floatl least = 0.0f, most = CHANNEL_MAX;
    const Color in_range = {clamp_lanes(sums.color.r, least, most), clamp_lanes(sums.color.g, least, most),
                            clamp_lanes(sums.color.b, least, most)};
    const Color c = select_color(any, in_range, none);
#if !ORIGINS && !GBUFFER
    if (!merge && count >= LANES) {
        store_lanes(z, depth + at);
        store_bytes(to_ucharl(any & 1), valid + at);
        write_color(color + CHANNELS * at, c);
        return;
    }
#endif
    for (int lane = 0; lane < min(count, LANES); lane++) {
        const size_t pixel = at + lane;
        const int is_any = int_lane(any, lane) != 0;
        if (merge && (!is_any || float_lane(z, lane) >= depth[pixel]))
            continue;
        depth[pixel] = float_lane(z, lane);
        valid[pixel] = is_any;
        write_pixel(color + CHANNELS * pixel, rounded_channel(color_lane(c, lane)));
#if ORIGINS
        const float2 from = (float2)(float_lane(sums.u, lane), float_lane(sums.v, lane));
        vstore2(is_any ? from : (float2)(NAN), pixel, source);
        source_view[pixel] = is_any ? (int)float_lane(sums.number, lane) : -1;
#endif
        float3 normal = 0.0f;
#if GBUFFER == 2
        normal = (float3)(float_lane(sums.normal.x, lane), float_lane(sums.normal.y, lane),
                          float_lane(sums.normal.z, lane));
        normal = 0.5f + 0.5f * normal;
#endif
        enter_pixel(gbuffer, pixel, depth[pixel], normal);
    }
}

/* first: 1 for the first stack, when `sums` is not set yet; last: 1 for the last stack, after which the picture is
 * written. If both are 1, the nearest layer is found here, and `best` is not read. */
kernel void blend_layers(global const float *stack, global const float *best, global float *sums,
                         global const BlendedView *views, int count, int first, int last, int pitch, float unit,
                         global float *depth, global channel *color, global uchar *valid, int width, int height,
                         int merge
#if ORIGINS
                         , global float *source, global int *source_view
#endif
                         GBUFFER_PARAMETERS)
{
    const int y = get_global_id(1), strip_x = get_global_id(0) * (STRIP * LANES);
    if (y >= height)
        return;
    const size_t plane = (size_t)height * pitch;
    const GBuffer gbuffer = GBUFFER_VALUE;
    for (int x0 = strip_x; x0 < min(strip_x + STRIP * LANES, width); x0 += LANES) {
        const size_t own = (size_t)y * pitch + x0;
        Blended made;
#define START(sum, number) made.sum = first ? (floatl)0.0f : load_lanes(sums + (number) * plane + own);
        EACH_SUM(START)
        Nearest nearest = {0.0f, 0.0f};
        if (first && last) {
            find_nearest(&nearest, stack + own, plane, views, count, unit);
        } else {
            nearest.z = load_lanes(best + own);
            nearest.off = load_lanes(best + plane + own);
        }
        for (int number = 0; number < count; number++) {
            global const float *layer = stack + number * LAYER_PLANES * plane + own;
            const floatl weight = load_lanes(layer + WEIGHT * plane);
            if (!any_lane(weight != 0.0f))
                continue;
            const floatl z = load_lanes(layer + DEPTH * plane);
            const floatl off = depth_tolerance(views[number], unit, z);
            const floatl allowed = sqrt(0.5f * (off * off + nearest.off * nearest.off));
            const intl may_count = (weight > 0.0f) | ((weight < 0.0f) & !(nearest.off > 0.0f));
            const intl counts = may_count & (z - nearest.z <= allowed);
            if (any_lane(counts))
                add_layer(&made, layer, plane, views[number], z, select_lanes(counts, fabs(weight), (floatl)0.0f));
        }
        if (last) {
            write_blend(made, (size_t)y * width + x0, width - x0, merge, depth, color, valid
#if ORIGINS
                        , source, source_view
#endif
                        , gbuffer);
        } else {
#define KEEP(sum, number) store_lanes(made.sum, sums + (number) * plane + own);
            EACH_SUM(KEEP)
        }
    }
}
