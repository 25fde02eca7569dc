/* Finds the pixels of a view behind which another camera may see the background, and cuts out the layer that is guessed
 * there (pyibr/warp/background.py).
 *
 * A pixel's envelope is the least nearness at which a surface hides the background from the camera. The camera's rays
 * are lines in the view. Along them, the envelope rises from each background pixel as the rays come nearer. A surface
 * nearer than its envelope hides background. lower_envelope is launched with steps of falling powers of two; after the
 * last one, the envelope is the least over all pixels of the line, as far as the steps lead.
 *
 * depth, valid: (height, width) of the view's picture. envelope, from, to: (height, width). away: the camera's centre as
 * homogeneous point (U, V, W, Q) of the view's pixel space (lib/pixelspace.h). stride: pixels. layer: (height, width) depth
 * of guesses and of a rim around them, NaN elsewhere. Work-item: `strip` times LANES pixels of a row, in
 * cut_out 48 pixels. Cost: O(pixels). Determinism: no kernel reads what it writes.
 */
#include "lib/pixelspace.h"
#include "lib/valid.h"
#include "warp/holes.h"

#define RIM 2 /* pixels of the rim: no crack opens between guesses and the view's samples */
#define RISE 0.9f /* times the true slope: the layer becomes a tenth deeper, so that its far side stays hidden */
#define ROW_PART 48 /* pixels of a work-item of cut_out */

typedef struct {
    float x, y, w, n;
} Away;

/* Nearness of a packet's pixels, the first of `left` ones; INFINITY where the view shows nothing. */
INLINED floatl seen_nearness(global const float *depth, global const uchar *valid, size_t pixel, int left, int perspective)
{
    const floatl z = load_first(depth + pixel, left, 1.0f);
    return select_lanes(load_first_bytes(valid + pixel, left, 0) == SEEN, DEPTH_OF(perspective, z), (floatl)INFINITY);
}

kernel void begin_envelope(global const float *depth, global const uchar *valid, global float *envelope, int width,
                           int height, int perspective, int strip)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + strip * LANES, width); x += LANES) {
        const size_t pixel = (size_t)y * width + x;
        store_first(seen_nearness(depth, valid, pixel, width - x, perspective), envelope + pixel, width - x);
    }
}

kernel void lower_envelope(global const float *from, global float *to, int width, int height, Away away, float stride,
                           int strip)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x0 = first; x0 < min(first + strip * LANES, width); x0 += LANES) {
        const size_t pixel = (size_t)y * width + x0;
        const floatl x = to_floatl(x0 + lane_index), dx = away.x - x * away.w, dy = away.y - y * away.w;
        const floatl part = stride / sqrt(dx * dx + dy * dy);
        const floatl u = x + part * dx, v = y + part * dy;
        const intl inside = (u > -0.5f) & (u < width - 0.5f) & (v > -0.5f) & (v < height - 0.5f);
        const intl at = to_intl(select_lanes(inside, v, (floatl)0.0f) + 0.5f) * width +
                        to_intl(select_lanes(inside, u, (floatl)0.0f) + 0.5f);
        const floatl n = (floatl)(gather(from, at)), before = away.n - n * away.w;
        const floatl raised = select_lanes(inside & (before > 0.0f), n + RISE * part * before, (floatl)INFINITY);
        store_first(min_lanes(load_first(from + pixel, width - x0, INFINITY), raised), to + pixel, width - x0);
    }
}

/* Makes pixels whose surface hides background holes. */
kernel void hide_foreground(global const float *envelope, global const float *depth, global uchar *valid, int width,
                            int height, int perspective, int strip)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + strip * LANES, width); x += LANES) {
        const size_t pixel = (size_t)y * width + x;
        const floatl n = seen_nearness(depth, valid, pixel, width - x, perspective);
        const intl is_background = load_first(envelope + pixel, width - x, INFINITY) >= n;
        store_first_bytes((n < INFINITY) & is_background & 1, valid + pixel, width - x);
    }
}

kernel void cut_out(global const float *depth, global const uchar *valid, global float *layer, int width, int height)
{
    const int first = get_global_id(0) * ROW_PART, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    ulong near = 0; /* bit i: column first - RIM + i holds a guess, in one of the rows */
    for (int v = y - RIM; v <= y + RIM; v++)
        near |= hole_bits(valid, width, height, first - RIM, v, 8);
    for (int i = 0; i < min(ROW_PART, width - first); i++) {
        const size_t pixel = (size_t)y * width + first + i;
        layer[pixel] = near >> i & (2ul << 2 * RIM) - 1 ? depth[pixel] : NAN;
    }
}
