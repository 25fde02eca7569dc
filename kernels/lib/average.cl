/* Anti-aliasing: each pixel from its samples, which lie on a regular grid of `side` x `side` within it.
 *
 * Colour is the mean of all samples, of which those that show nothing are black: colour times coverage. Depth is of what
 * is in front: the mean nearness (affine on a plane) of all samples if the pixel shows one surface, else of those that
 * lie closer to the nearest one than to the farthest.
 * sample_depth, sample_color, sample_valid: (side * height, side * width), depth NaN where nothing shows. depth, color:
 * (height, width); valid: whether any sample is; alpha: the share of the samples that show something.
 * Work-item: a pixel. Cost: O(samples). Determinism: every pixel on its own.
 */
#include "lib/color.h"

#define SMALL 0.01f /* of the nearness: within it samples show one surface, as in lib/pane.cl */

kernel void average(global const float *sample_depth, global const channel *sample_color, global const uchar *sample_valid,
                    int side, int width, int height, int perspective, global float *depth, global channel *color,
                    global uchar *valid, global float *alpha)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    float3 sum = 0.0f;
    float low = INFINITY, high = -INFINITY;
    int count = 0, any = 0;
    for (int j = 0; j < side; j++) {
        const size_t row = ((size_t)y * side + j) * width * side + (size_t)x * side;
        for (int i = 0; i < side; i++) {
            const float z = sample_depth[row + i], n = perspective ? 1.0f / z : -z;
            if (z == z) {
                low = fmin(low, n);
                high = fmax(high, n);
                count++;
            }
            any |= sample_valid[row + i];
            sum += read_pixel(sample_color + CHANNELS * (row + i));
        }
    }
    const float least = high - low <= SMALL * fabs(high) ? low : 0.5f * (low + high);
    float nearness = 0.0f;
    int front = 0;
    for (int j = 0; j < side; j++) {
        const size_t row = ((size_t)y * side + j) * width * side + (size_t)x * side;
        for (int i = 0; i < side; i++) {
            const float z = sample_depth[row + i], n = perspective ? 1.0f / z : -z;
            const int in_front = n >= least; /* not of NaN */
            nearness += in_front ? n : 0.0f;
            front += in_front;
        }
    }
    const size_t at = (size_t)y * width + x;
    const float mean = nearness / front;
    depth[at] = count == 0 ? NAN : perspective ? 1.0f / mean : -mean;
    valid[at] = any;
    alpha[at] = (float)count / (side * side);
    write_pixel(color + CHANNELS * at, sum / (side * side));
}
