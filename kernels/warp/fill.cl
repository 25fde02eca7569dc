/* Holes filled from the farther side: a disocclusion lies on an epipolar line between the edge of what hid it and the
 * background that it belongs to, so of the two valid pixels at its ends along that line the farther one's colour and
 * depth are taken; ends of about the same depth are blended by distance.
 *
 * color, depth: (height, width), written where valid is 0, read where it is 1. blocks: 16 x 16 pixels each, whether
 * any of them is valid, so that large holes are crossed in large steps. Work-item: one block, then `run` pixels of
 * a row.
 * Cost: O(pixels * hole / 16). Determinism: no pixel that is written is read.
 */
#include "lib/channel.h"

#define BLOCK 16
#define SAME_DEPTH 1.02f  /* ends whose depths differ by no more than this ratio are one background, */
#define OTHER_DEPTH 1.1f /* and by more than this two; between them the one passes into the other */

kernel void fill_blocks(global const uchar *valid, global uchar *blocks, int width, int height)
{
    const int bx = get_global_id(0), by = get_global_id(1);
    const int across = (width + BLOCK - 1) / BLOCK;
    if (bx >= across || by * BLOCK >= height)
        return;
    uchar any_valid = 0;
    for (int y = by * BLOCK; y < min((by + 1) * BLOCK, height); y++)
        for (int x = bx * BLOCK; x < min((bx + 1) * BLOCK, width); x++)
            any_valid |= valid[(size_t)y * width + x];
    blocks[by * across + bx] = any_valid;
}

/* The first valid pixel from (x, y) along (dx, dy): its index and distance in steps, or index -1. */
int2 first_valid(global const uchar *valid, global const uchar *blocks, int width, int height, int x, int y, float dx,
                 float dy)
{
    const int across = (width + BLOCK - 1) / BLOCK;
    int step = 1;
    for (;;) {
        const int px = convert_int_rte(x + step * dx), py = convert_int_rte(y + step * dy);
        if (px < 0 || px >= width || py < 0 || py >= height)
            return (int2)(-1, 0);
        if (blocks[(py / BLOCK) * across + px / BLOCK]) {
            if (valid[(size_t)py * width + px])
                return (int2)(py * width + px, step);
            step++;
        } else { /* to where the line leaves the block */
            const float edge_x = (px / BLOCK + (dx > 0.0f)) * BLOCK - 0.5f, edge_y = (py / BLOCK + (dy > 0.0f)) * BLOCK - 0.5f;
            const float leave_x = dx != 0.0f ? (edge_x - x) / dx : INFINITY, leave_y = dy != 0.0f ? (edge_y - y) / dy : INFINITY;
            step = max(step + 1, convert_int_sat(floor(fmin(leave_x, leave_y))));
        }
    }
}

void fill_hole(global channel *color, global float *depth, global const uchar *valid, global const uchar *blocks, int width,
               int height, int x, int y, float epipole_x, float epipole_y, float epipole_w)
{
    float dx = x * epipole_w - epipole_x, dy = y * epipole_w - epipole_y;
    const float longest = fmax(fabs(dx), fabs(dy));
    dx = longest > 0.0f ? dx / longest : 1.0f;
    dy = longest > 0.0f ? dy / longest : 0.0f;
    const int2 a = first_valid(valid, blocks, width, height, x, y, dx, dy);
    const int2 b = first_valid(valid, blocks, width, height, x, y, -dx, -dy);
    if (a.x < 0 && b.x < 0)
        return;
    const float za = a.x < 0 ? -INFINITY : depth[a.x], zb = b.x < 0 ? -INFINITY : depth[b.x];
    float part = za >= zb ? 0.0f : 1.0f; /* of b */
    if (a.x >= 0 && b.x >= 0)
        part = mix((float)a.y / (a.y + b.y), part, smoothstep(SAME_DEPTH, OTHER_DEPTH, fmax(za, zb) / fmin(za, zb)));
    const size_t at = (size_t)y * width + x;
    const int ia = a.x < 0 ? b.x : a.x, ib = b.x < 0 ? a.x : b.x;
    depth[at] = mix(depth[ia], depth[ib], part);
    for (int c = 0; c < 3; c++)
        color[3 * at + c] = to_channel(mix((float)color[3 * (size_t)ia + c], (float)color[3 * (size_t)ib + c], part));
}

kernel void fill_holes(global channel *color, global float *depth, global const uchar *valid, global const uchar *blocks,
                       int width, int height, int run, float epipole_x, float epipole_y, float epipole_w)
{
    const int first = get_global_id(0) * run, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + run, width); x++)
        if (!valid[(size_t)y * width + x])
            fill_hole(color, depth, valid, blocks, width, height, x, y, epipole_x, epipole_y, epipole_w);
}
