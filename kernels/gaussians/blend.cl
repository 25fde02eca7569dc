/* Blends splats into a picture, from front to back, in front of the surfaces in its depth buffer (Kerbl et al. 2023,
 * section 6).
 *
 * Each pixel goes through the list of its bin. A splat's opacity there is at most OPACITY_MAX; below 1/255 it counts as
 * 0. A splat is drawn where its plane is nearer than the surface. A pixel is done when its transmittance is at most
 * TRANSMITTANCE_MIN; the picture's own colour gets the rest. Where the transmittance falls to one half, the depth
 * becomes that of this splat's plane, and `valid` 1.
 *
 * list, starts: the bins' splats (raster/bins.cl), as indices into `places`. places: indices of records, by distance.
 * records: Splats. depth, color, valid, alpha: the picture and its opacity. Work-item: a bin on a CPU, whose rows are
 * one packet each; a pixel on a GPU. Cost: O(list * rows) on a CPU, O(pixels * list) on a GPU, less where pixels close
 * early or surfaces hide splats. Determinism: each pixel's order is that of the list.
 */
#include "gaussians/splat.h"
#include "lib/color.h"
#include "lib/screen.h"

#define OPACITY_MAX 0.99f
#define TRANSMITTANCE_MIN 1e-4f
#define AHEAD 8 /* splats that are prefetched */
#if LANES == 16
#define BIN_ROWS BIN /* rows of pixels that a work-item draws; BIN is LANES */
#define ROW_INDEX(row) (row)
#else
#define BIN_ROWS 1
#define ROW_INDEX(row) 0
#endif

/* The pixels of a work-item: LANES columns, from (x, y) on. On a GPU each array has one element, and is a register. */
typedef struct {
    floatl transmittance[BIN_ROWS];
    Color sum[BIN_ROWS];
    floatl median[BIN_ROWS];  /* nearness where the transmittance falls to one half; EMPTY: nowhere */
    floatl surface[BIN_ROWS]; /* nearness of the picture's surface; EMPTY: none */
    int x, y, rows, bounded;  /* bounded: whether there is any surface */
    float hidden;             /* nearness of the farthest surface, behind which all is hidden; EMPTY: none */
    uint open;                /* rows, as bits, with a pixel that is not closed */
} BlendedPixels;

/* 2^x for x from -126 to 0, to within 2e-7 of the value */
INLINED floatl power_of_two(floatl x)
{
    const intl whole = to_intl(x - 0.5f); /* the nearest integer, as conversion truncates towards 0 */
    const floatl f = x - to_floatl(whole);
    floatl p = 1.5353362e-4f;
    p = p * f + 1.3398874e-3f;
    p = p * f + 9.6184373e-3f;
    p = p * f + 5.5503324e-2f;
    p = p * f + 2.4022648e-1f;
    p = p * f + 6.9314718e-1f;
    p = p * f + 1.0f;
    return as_floatl(as_intl(p) + (whole << 23));
}

INLINED void blend_splat(BlendedPixels *pixels, global const SplatRecord *splat)
{
    if (splat->most <= pixels->hidden)
        return;
    const float u = splat->u, v = splat->v, along = splat->along, reach = splat->reach;
    const float nearness_y = splat->nearness_y, least = splat->least, most = splat->most;
    const floatl dx = to_floatl(pixels->x + (intl)lane_index) - u;
    const floatl base = splat->strength - splat->across * dx * dx, lean = splat->lean * dx;
    const floatl plane = splat->nearness + splat->nearness_x * dx;
    const int first = (int)ceil(clamp(v - reach - pixels->y, 0.0f, (float)BIN_ROWS));
    const int last = (int)floor(clamp(v + reach - pixels->y, -1.0f, pixels->rows - 1.0f));
    for (int row = first; row <= last; row++) {
        if (!((pixels->open >> row) & 1))
            continue;
        const int k = ROW_INDEX(row);
        const float dy = pixels->y + row - v;
        const floatl t = along * dy - lean, strength = base - t * t, before = pixels->transmittance[k];
        intl drawn = (strength > LEAST_OPACITY_LOG2) & (before > TRANSMITTANCE_MIN);
        if (pixels->bounded)
            drawn = drawn & (clamp_lanes(plane + nearness_y * dy, (floatl)least, (floatl)most) > pixels->surface[k]);
        if (!any_lane(drawn))
            continue;
        const floatl opacity = min_lanes(power_of_two(max_lanes(strength, (floatl)-10.0f)), (floatl)OPACITY_MAX);
        const floatl weight = select_lanes(drawn, opacity, (floatl)0.0f) * before, after = before - weight;
        const Color color = {splat->r, splat->g, splat->b};
        add_color(&pixels->sum[k], weight, color);
        pixels->transmittance[k] = after;
        const intl halved = (before > 0.5f) & (after <= 0.5f);
        if (any_lane(halved))
            pixels->median[k] = select_lanes(
                halved, clamp_lanes(plane + nearness_y * dy, (floatl)least, (floatl)most), pixels->median[k]);
        if (!any_lane(after > TRANSMITTANCE_MIN))
            pixels->open &= ~(1u << row);
    }
}

INLINED void begin_pixels(BlendedPixels *pixels, Screen screen, global const float *depth)
{
    const int count = screen.width - pixels->x;
    pixels->rows = min(BIN_ROWS, screen.height - pixels->y);
    pixels->open = (1u << pixels->rows) - 1;
    pixels->bounded = 0;
    floatl hidden = INFINITY;
    for (int row = 0; row < pixels->rows; row++) {
        const Color none = {0.0f, 0.0f, 0.0f};
        const floatl z = load_first(depth + (size_t)(pixels->y + row) * screen.width + pixels->x, count, NAN);
        const intl drawn = z == z, within = (intl)lane_index < count;
        const floatl surface = select_lanes(drawn, DEPTH_OF(screen.perspective, z), (floatl)EMPTY);
        hidden = select_lanes(within, min_lanes(hidden, surface), hidden);
        pixels->surface[ROW_INDEX(row)] = surface;
        pixels->bounded |= any_lane(drawn);
        pixels->transmittance[ROW_INDEX(row)] = select_lanes(within, (floatl)1.0f, (floatl)0.0f);
        pixels->sum[ROW_INDEX(row)] = none;
        pixels->median[ROW_INDEX(row)] = EMPTY;
    }
    pixels->hidden = least_lane(hidden);
}

/* The picture's colours at LANES pixels; `read_color` needs at least two pixels in all. */
INLINED Color old_color(global const channel *color, intl index, int pixels)
{
    const float3 only = read_pixel(color);
    const Color one = {only.x, only.y, only.z};
    return pixels == 1 ? one : read_color(color, index, pixels);
}

INLINED void end_pixels(const BlendedPixels *pixels, Screen screen, global float *depth, global channel *color,
                        global uchar *valid, global float *alpha)
{
    const int count = min(screen.width - pixels->x, LANES);
    for (int row = 0; row < pixels->rows; row++) {
        const size_t at = (size_t)(pixels->y + row) * screen.width + pixels->x;
        const floatl rest = pixels->transmittance[ROW_INDEX(row)], median = pixels->median[ROW_INDEX(row)];
        if (!any_lane((rest < 1.0f) & ((intl)lane_index < count)))
            continue;
        store_first(1.0f - (1.0f - load_first(alpha + at, count, 0.0f)) * rest, alpha + at, count);
        const intl index = min((intl)lane_index, (intl)(count - 1)) + (int)at;
        const Color old = old_color(color, index, screen.width * screen.height), sum = pixels->sum[ROW_INDEX(row)];
        const floatl white = CHANNEL_MAX;
        const Color made = {min_lanes(sum.r * white + rest * old.r, white), min_lanes(sum.g * white + rest * old.g, white),
                            min_lanes(sum.b * white + rest * old.b, white)};
        write_first(color + CHANNELS * at, made, count);
        const intl halved = median != EMPTY;
        if (!any_lane(halved))
            continue;
        const floatl z = load_first(depth + at, count, NAN);
        store_first(select_lanes(halved, DRAWN_DEPTH(screen, median), z), depth + at, count);
        const intl shown = load_first_bytes(valid + at, count, 0);
        store_first_bytes(select_lanes(halved, (intl)1, shown), valid + at, count);
    }
}

kernel void blend_gaussians(global const float *records, global const int *places, global const int *list,
                            global const int *starts, int bins_x, Screen screen, global float *depth,
                            global channel *color, global uchar *valid, global float *alpha)
{
    BlendedPixels pixels;
    pixels.x = get_global_id(0) * LANES;
    pixels.y = get_global_id(1) * BIN_ROWS;
    if (pixels.x >= screen.width || pixels.y >= screen.height)
        return;
    const int bin = pixels.y / BIN * bins_x + pixels.x / BIN;
    begin_pixels(&pixels, screen, depth);
    const int last = starts[bin + 1];
    for (int i = starts[bin]; i < last && pixels.open; i++) {
        prefetch_at(records + RECORD * (size_t)places[list[min(i + AHEAD, last - 1)]]);
        blend_splat(&pixels, (global const SplatRecord *)(records + RECORD * (size_t)places[list[i]]));
    }
    end_pixels(&pixels, screen, depth, color, valid, alpha);
}
