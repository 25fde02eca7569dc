/* Draws objects one sample thin, such as wires, leaves and bars, as ribbons (lib/ribbons.h) with the width of a sample.
 *
 * Launches: the first finds at each pixel the greatest nearness of a ribbon; the second, the least number of a ribbon
 * with this nearness; the third writes the pixels where a ribbon is nearer than the picture or the picture is empty. A
 * ribbon is also drawn behind a surface that turns a side to the target that is not shown. keys, indices: (dst_height,
 * dst_width), keys.h. ribbons: (count,) numbers of the view's ribbons (picture/ribbons.cl). source, source_view: as in
 * resolve.cl. Work-item: a ribbon; in the third launch, STRIP * LANES pixels of a row. Cost: O(pixels + pixels of
 * ribbons). Determinism: maximum and minimum do not depend on the order of work-items.
 * In the paper there are no ribbons, as all samples are connected.
 */
#include "lib/channel.h"
#include "lib/gbuffer.h"
#include "lib/lanes.h"
#include "lib/ribbons.h"
#include "warp/keys.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: the origins of pixels are written, too */
#endif
#define RIBBON_WIDTH_MAX 256 /* target pixels: greatest width and height of a ribbon's bounding box */
#define NO_RIBBON 0xFFFFFFFFu
#define END_BIAS 1024u /* units of the key's last bit: subtracted from keys beyond a ribbon's two samples, so that a
                           surface that goes on there in the same plane shows its own colours */
#define NEARER 1e-6f /* fraction of the depth by which a ribbon must be nearer: at samples, surfaces are as near */

/* A ribbon is the area that a square covers as it moves. [*low, *high] is the part of the motion, 0 to 1, during which
 * the square covers a point; this function narrows it by the offset along one axis. p: the point's offset from the
 * first square's middle; d: the motion */
void narrow_sweep(float p, float d, float *low, float *high)
{
    if (fabs(d) > 1e-6f) {
        const float a = (p - 0.5f) / d, b = (p + 0.5f) / d;
        *low = fmax(*low, fmin(a, b));
        *high = fmin(*high, fmax(a, b));
    } else if (!(fabs(p) <= 0.5f)) {
        *high = -1.0f;
    }
}

/* The target nearness at which a pixel's ray meets a ribbon; EMPTY if it meets none. Sets `part`, the position along
 * the ribbon: 0 at the first sample, 1 at the second. */
float intersect_ribbon(Ribbon ribbon, PixelMap map, int sides, int column, int row, float *part)
{
    const float *S = map.src_from_dst;
    const float u = PIXEL_ROW(S, 0, column, row), v = PIXEL_ROW(S, 1, column, row), w = PIXEL_ROW(S, 2, column, row);
    const float at_start = PIXEL_ROW(S, 3, column, row) - ribbon.n * w - ribbon.gu * (u - ribbon.x * w) -
                           ribbon.gv * (v - ribbon.y * w);
    const float per_unit = S[15] - ribbon.n * S[11] - ribbon.gu * (S[3] - ribbon.x * S[11]) -
                           ribbon.gv * (S[7] - ribbon.y * S[11]);
    const float met = -at_start / per_unit, w_met = w + met * S[11];
    const float2 p = (float2)((u + met * S[3]) / w_met - ribbon.x, (v + met * S[7]) / w_met - ribbon.y);
    float low = 0.0f, high = 1.0f;
    narrow_sweep(p.x, ribbon.dx, &low, &high);
    narrow_sweep(p.y, ribbon.dy, &low, &high);
    *part = ribbon.part + ribbon.part_u * p.x + ribbon.part_v * p.y;
    const int is_on = low <= high && !(ribbon.ends && *part > 1.0f) && w_met > 0.0f && !belongs_to_another(ribbon, p);
    const int shows = (per_unit > 0.0f && (sides & SHOWS_FRONT)) || (per_unit < 0.0f && (sides & SHOWS_BACK));
    return is_on && shows && IS_BEFORE(map.dst_perspective, met) ? met : EMPTY;
}

/* Enters a ribbon's nearness into the keys, or its number into the indices. */
void draw_ribbon(Ribbon ribbon, PixelMap map, int sides, uint number, global uint *keys, global uint *indices,
                 int by_index)
{
    const float *D = map.dst_from_src;
    float low_u = INFINITY, low_v = INFINITY, high_u = -INFINITY, high_v = -INFINITY;
    for (int i = 0; i < 8; i++) { /* corners of the squares at both ends */
        const float dx = (i & 1 ? 0.5f : -0.5f) + (i & 4 ? ribbon.dx : 0.0f),
                    dy = (i & 2 ? 0.5f : -0.5f) + (i & 4 ? ribbon.dy : 0.0f);
        const float cx = ribbon.x + dx, cy = ribbon.y + dy, n = ribbon.n + ribbon.gu * dx + ribbon.gv * dy;
        const float w = MAP_ROW(D, 2, cx, cy, n);
        if (!(w > 0.0f))
            return;
        const float u = MAP_ROW(D, 0, cx, cy, n) / w, v = MAP_ROW(D, 1, cx, cy, n) / w;
        low_u = fmin(low_u, u);
        high_u = fmax(high_u, u);
        low_v = fmin(low_v, v);
        high_v = fmax(high_v, v);
    }
    const int left = convert_int_sat(ceil(clamp(low_u, 0.0f, (float)map.dst_width)));
    const int top = convert_int_sat(ceil(clamp(low_v, 0.0f, (float)map.dst_height)));
    const int right = min(convert_int_sat(floor(clamp(high_u, -1.0f, map.dst_width - 1.0f))), left + RIBBON_WIDTH_MAX);
    const int bottom = min(convert_int_sat(floor(clamp(high_v, -1.0f, map.dst_height - 1.0f))), top + RIBBON_WIDTH_MAX);
    for (int row = top; row <= bottom; row++)
        for (int column = left; column <= right; column++) {
            float part;
            const float met = intersect_ribbon(ribbon, map, sides, column, row, &part);
            if (!IS_HIT(met))
                continue;
            enter_key(keys, indices, by_index, row * map.dst_width + column,
                      key_of(met) - (part < 0.0f || part > 1.0f ? END_BIAS : 0u), number);
        }
}

kernel void draw_ribbons(global const float *surface, global const uint *ribbons, int count, global uint *keys,
                         global uint *indices, int by_index, PixelMap map, Cut cut, int sides)
{
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, cut);
    const int i = get_global_id(0);
    if (i < count)
        draw_ribbon(numbered_ribbon(grid, ribbons[i]), map, sides, ribbons[i], keys, indices, by_index);
}

void mix_colors(global const channel *src_color, int a, int b, float part, global channel *color)
{
    for (int c = 0; c < CHANNELS; c++) {
        const float from = src_color[CHANNELS * (size_t)a + c], to = src_color[CHANNELS * (size_t)b + c];
        color[c] = to_channel(from + part * (to - from));
    }
}

/* Writes the pixel (x, y) of a ribbon, unless the picture is nearer there. Returns 1 if it was written. Sets `ends`,
 * the samples at the ribbon's ends, and `along`, the pixel's position between them, 0 to 1. */
int write_ribbon(Grid grid, uint number, PixelMap map, int sides, int linear, int x, int y,
                 global const channel *src_color, global float *depth, global channel *color, global uchar *valid,
                 global float *source, global int *source_view, int view, int2 *ends, float *along)
{
    const float *D = map.dst_from_src;
    const Ribbon ribbon = numbered_ribbon(grid, number);
    float part, met = intersect_ribbon(ribbon, map, sides, x, y, &part);
    const int2 nearest = part > 0.5f ? ribbon.to : ribbon.from;
    part = clamp(part, 0.0f, 1.0f);
    if (!linear) {
        part = part > 0.5f;
        const float q = sample_at(grid, nearest.x, nearest.y), w = MAP_ROW(D, 2, nearest.x, nearest.y, q);
        met = w > 0.0f ? MAP_ROW(D, 3, nearest.x, nearest.y, q) / w : met;
    }
    const float z = DEPTH_OF(map.dst_perspective, met);
    if (!IS_HIT(met) || !IS_BEFORE(map.dst_perspective, met) || (*valid && z >= *depth - NEARER * fabs(*depth)))
        return 0;
    *depth = z;
    *valid = 1;
    *ends = (int2)(ribbon.from.y, ribbon.to.y) * grid.width + (int2)(ribbon.from.x, ribbon.to.x);
    mix_colors(src_color, ends->x, ends->y, part, color);
#if ORIGINS
    vstore2(convert_float2(nearest), 0, source); /* the nearest sample: between samples, the object may end */
    *source_view = view;
#endif
    *along = part;
    return 1;
}

kernel void thin_pixels(global const float *surface, global const uint *keys, global const uint *indices,
                        global const channel *src_color, global float *depth, global channel *color, global uchar *valid,
                        PixelMap map, Cut cut, int sides, int linear
#if ORIGINS
                        ,
                        global float *source, global int *source_view, int view
#endif
                            GBUFFER_PARAMETERS NORMALS_PARAMETER(float))
{
    const int y = get_global_id(1);
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, cut);
    if (y >= map.dst_height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < map.dst_width;
         x0 += LANES, packet++) {
        const size_t at = (size_t)y * map.dst_width + x0;
        if (x0 + LANES <= map.dst_width && !any_lane(as_intl(load_lanes(keys + at)) != 0))
            continue; /* most packets have none */
        for (int i = 0; i < min(LANES, map.dst_width - x0); i++) {
            if (!keys[at + i] || indices[at + i] == NO_RIBBON)
                continue;
            int2 ends;
            float along;
            const int written = write_ribbon(grid, indices[at + i], map, sides, linear, x0 + i, y, src_color,
                                             depth + at + i, color + CHANNELS * (at + i), valid + at + i,
#if ORIGINS
                                             source + 2 * (at + i), source_view + at + i, view,
#else
                                             0, 0, 0,
#endif
                                             &ends, &along);
            if (!written)
                continue;
            const GBuffer gbuffer = GBUFFER_VALUE;
            float3 normal = 0.0f;
#if GBUFFER == 2
            normal = mix(vload3(ends.x, normals), vload3(ends.y, normals), along);
#endif
            enter_pixel(gbuffer, at + i, depth[at + i], normal);
        }
    }
}
