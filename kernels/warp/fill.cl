/* Holes filled from the farther side: a disocclusion lies on an epipolar line between the edge of what hid it and the
 * background that it belongs to, so of the two valid pixels at its ends along that line the farther one's colour and
 * depth are taken; ends of about the same depth are blended by distance.
 *
 * A line goes from a hole in steps of a pixel along its longer axis; each step is at the nearest pixel. Where it is the
 * same through all of its pixels, along rows, columns or diagonals, the holes between two ends are filled at once
 * (fill_runs). Elsewhere each hole looks for its own ends (fill_holes), and crosses what is hole alone in large steps.
 *
 * color, depth: (height, width), written where valid is 0, read where it is 1. blocks: BLOCK x BLOCK pixels each, whether
 * any of them is valid. epipole: the lines lead away from it; all 0: they are the rows. dx, dy: -1, 0 or 1, a step along
 * all lines. Work-item: one block (fill_blocks); else `run` pixels of a row, and in fill_runs the holes of all lines that
 * begin in them.
 * Cost: fill_runs O(pixels), fill_holes O(pixels + holes * hole's length), of which whole blocks count once.
 * Determinism: no pixel that is written is read.
 */
#include "lib/channel.h"

#define BLOCK 32
#define BLOCK_EDGE 0.49f /* pixels from a block's outermost centres to its edge, less what rounding may move a step by */
#define FILL_BACKGROUND 0
#ifndef FILL
#define FILL FILL_BACKGROUND /* which way of filling this is: so far there is but one */
#endif
#define SAME_DEPTH 1.02f /* ends whose depths differ by no more than this ratio are one background, */
#define OTHER_DEPTH 1.1f /* and by more than this two; between them the one passes into the other */

typedef struct {
    float4 a, b; /* colour and depth of the valid pixels at a line's ends */
    float part;  /* of b, if the ends are two backgrounds */
    float apart; /* whether they are: 0 to 1 */
} Ends;

/* Of the pixels a and b; -1: there is none on that side. */
Ends ends_at(global const channel *color, global const float *depth, int a, int b)
{
    const size_t ia = a < 0 ? b : a, ib = b < 0 ? a : b;
    const float za = depth[ia], zb = depth[ib];
    Ends ends = {(float4)(color[3 * ia], color[3 * ia + 1], color[3 * ia + 2], za),
                 (float4)(color[3 * ib], color[3 * ib + 1], color[3 * ib + 2], zb), 0.0f, 1.0f};
    if (a >= 0 && b >= 0) {
        ends.part = za >= zb ? 0.0f : 1.0f;
        ends.apart = smoothstep(SAME_DEPTH, OTHER_DEPTH, fmax(za, zb) / fmin(za, zb));
    }
    return ends;
}

/* A hole so many steps from its ends */
void fill_hole(global channel *color, global float *depth, int hole, Ends ends, int to_a, int to_b)
{
    const float4 behind = mix(ends.a, ends.b, mix((float)to_a / (to_a + to_b), ends.part, ends.apart));
    vstore3(to_channels(behind).xyz, (size_t)hole, color);
    depth[hole] = behind.w;
}

/* How many steps of dx lead from x to the border of `size` pixels. */
int steps_to_border(int x, int dx, int size)
{
    return dx > 0 ? size - 1 - x : dx < 0 ? x : INT_MAX;
}

kernel void fill_runs(global channel *color, global float *depth, global const uchar *valid, int width, int height, int run,
                      int dx, int dy)
{
    const int first = get_global_id(0) * run, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    const int beyond = min(first + run, width), step = dy * width + dx;
    uchar all_valid = 1; /* Most work-items end after this loop, which compilers make wide. */
    for (int x = first; x < beyond; x++)
        all_valid &= valid[y * width + x];
    if (all_valid)
        return;
    for (int x = first; x < beyond; x++) {
        const int hole = y * width + x;
        if (valid[hole])
            continue;
        const int is_inside = min(steps_to_border(x, dx, width), steps_to_border(y, dy, height)) > 0;
        if (is_inside && !valid[hole + step])
            continue; /* It is filled together with the first of these holes. */
        const int most = 1 + min(steps_to_border(x, -dx, width), steps_to_border(y, -dy, height));
        int length = 1;
        while (length < most && !valid[hole - length * step])
            length++;
        const int a = is_inside ? hole + step : -1, b = length < most ? hole - length * step : -1;
        if (a < 0 && b < 0)
            continue;
        const Ends ends = ends_at(color, depth, a, b);
        for (int i = 0; i < length; i++)
            fill_hole(color, depth, hole - i * step, ends, i + 1, length - i);
    }
}

kernel void fill_blocks(global const uchar *valid, global uchar *blocks, int width, int height)
{
    const int bx = get_global_id(0), by = get_global_id(1);
    const int across = (width + BLOCK - 1) / BLOCK;
    if (bx >= across || by * BLOCK >= height)
        return;
    uchar any_valid = 0;
    for (int y = by * BLOCK; y < min((by + 1) * BLOCK, height); y++)
        for (int x = bx * BLOCK; x < min((bx + 1) * BLOCK, width); x++)
            any_valid |= valid[y * width + x];
    blocks[by * across + bx] = any_valid;
}

/* The first valid pixel from (x, y) along (dx, dy): its index and distance in steps, or index -1. */
int2 first_valid(global const uchar *valid, global const uchar *blocks, int width, int height, int x, int y, float dx,
                 float dy)
{
    const int across = (width + BLOCK - 1) / BLOCK;
    const float edge_x = dx > 0.0f ? BLOCK - 1 + BLOCK_EDGE : -BLOCK_EDGE, steps_per_x = 1.0f / fabs(dx);
    const float edge_y = dy > 0.0f ? BLOCK - 1 + BLOCK_EDGE : -BLOCK_EDGE, steps_per_y = 1.0f / fabs(dy);
    int step = 1;
    for (;;) {
        const int px = convert_int_rte(x + step * dx), py = convert_int_rte(y + step * dy);
        if (px < 0 || px >= width || py < 0 || py >= height)
            return (int2)(-1, 0);
        if (valid[py * width + px])
            return (int2)(py * width + px, step);
        step++;
        if (!blocks[(py / BLOCK) * across + px / BLOCK]) { /* to the last step before the line leaves the block */
            const float to_x = fabs(px / BLOCK * BLOCK + edge_x - x) * steps_per_x;
            const float to_y = fabs(py / BLOCK * BLOCK + edge_y - y) * steps_per_y;
            step = max(step, (int)fmin(to_x, to_y));
        }
    }
}

kernel void fill_holes(global channel *color, global float *depth, global const uchar *valid, global const uchar *blocks,
                       int width, int height, int run, float epipole_x, float epipole_y, float epipole_w)
{
    const int first = get_global_id(0) * run, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + run, width); x++) {
        const int hole = y * width + x;
        if (valid[hole])
            continue;
        float dx = x * epipole_w - epipole_x, dy = y * epipole_w - epipole_y;
        const float longest = fmax(fabs(dx), fabs(dy));
        dx = longest > 0.0f ? dx / longest : 1.0f;
        dy = longest > 0.0f ? dy / longest : 0.0f;
        const int2 a = first_valid(valid, blocks, width, height, x, y, dx, dy);
        const int2 b = first_valid(valid, blocks, width, height, x, y, -dx, -dy);
        if (a.x >= 0 || b.x >= 0)
            fill_hole(color, depth, hole, ends_at(color, depth, a.x, b.x), a.y, b.y);
    }
}
