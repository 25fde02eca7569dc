/* The depth behind holes, along epipolar lines: a disocclusion lies on its line between the edge of what hid it and the
 * background that it belongs to, so the farther of the two valid pixels at its ends has the depth behind it.
 *
 * A line goes from a hole in steps of a pixel along its longer axis; each step is at the nearest pixel. Where it is the
 * same through all of its pixels, along rows, columns or diagonals, the holes between two ends are written at once
 * (behind_runs). Elsewhere each hole searches for its own ends (behind_lines), and crosses blocks of holes in large
 * steps; only holes beside valid pixels do, since fill.cl needs no others.
 *
 * depth, valid: (height, width). behind: holes.h, rows of `pitch`, written in holes alone: the depth behind them; 0
 * where the line ends at the picture's border on both sides. blocks: SKIP_BLOCK x SKIP_BLOCK pixels each, whether any
 * of them is valid. epipole: the lines lead away from it; all 0: they are the rows. dx, dy: -1, 0 or 1, a step along
 * all lines, down or, along rows, right.
 * Work-item: one block (behind_blocks); 64 * `strip` pixels of a row, and the holes of all lines that begin in them
 * (behind_runs); `run` pixels of a row (behind_lines). Cost: behind_runs O(pixels), behind_lines O(pixels + holes
 * beside valid pixels * hole's length), of which whole blocks count once. Determinism: no pixel that is written is
 * read.
 */
#include "warp/holes.h"

#define SKIP_BLOCK 32
#define SKIP_BLOCK_EDGE 0.49f /* pixels from a block's outermost centres to its edge, less what rounding may move a step by */

/* The holes of the lines that begin in 64 pixels of a row; begins: the first hole of each, as bits */
void follow_runs(global const float *depth, global const uchar *valid, global float *behind, int width, int height,
                 int pitch, int dx, int dy, int x0, int y0, ulong begins)
{
    const int step = dy * width + dx;
    for (; begins; begins &= begins - 1) {
        const int first = x0 + LOWEST(begins);
        int x = first, y = y0, pixel = y0 * width + first;
        const float before = x - dx < 0 || x - dx >= width || y - dy < 0 ? 0.0f : depth[pixel - step];
        int length = 0, is_inside;
        do {
            x += dx, y += dy, pixel += step, length++;
            is_inside = x >= 0 && x < width && y < height;
        } while (is_inside && !valid[pixel]);
        const float far = fmax(before, is_inside ? depth[pixel] : 0.0f);
        global float *out = behind + (size_t)(y0 + HALO) * pitch + first + HALO;
        for (int i = 0; i < length; i++)
            out[i * (dy * pitch + dx)] = far;
    }
}

kernel void behind_runs(global const float *depth, global const uchar *valid, global float *behind, int width, int height,
                        int pitch, int strip, int dx, int dy)
{
    const int first = get_global_id(0) * 64 * strip, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + 64 * strip, width); x += 64) {
        const ulong holes = hole_bits(valid, width, height, x, y, 8);
        if (holes)
            follow_runs(depth, valid, behind, width, height, pitch, dx, dy, x, y,
                        holes & ~hole_bits(valid, width, height, x - dx, y - dy, 8));
    }
}

kernel void behind_blocks(global const uchar *valid, global uchar *blocks, int width, int height)
{
    const int bx = get_global_id(0), by = get_global_id(1);
    const int across = (width + SKIP_BLOCK - 1) / SKIP_BLOCK;
    if (bx >= across || by * SKIP_BLOCK >= height)
        return;
    uchar any_valid = 0;
    for (int y = by * SKIP_BLOCK; y < min((by + 1) * SKIP_BLOCK, height); y++)
        for (int x = bx * SKIP_BLOCK; x < min((bx + 1) * SKIP_BLOCK, width); x++)
            any_valid |= valid[y * width + x];
    blocks[by * across + bx] = any_valid;
}

/* Beside a valid pixel, or at the border */
int is_edge(global const uchar *valid, int width, int height, int x, int y)
{
    uchar any = x == 0 || y == 0 || x == width - 1 || y == height - 1;
    for (int v = max(y - 1, 0); v <= min(y + 1, height - 1); v++)
        for (int u = max(x - 1, 0); u <= min(x + 1, width - 1); u++)
            any |= valid[v * width + u];
    return any;
}

/* The depth of the first valid pixel from (x, y) along (dx, dy), or 0. */
float depth_along(global const float *depth, global const uchar *valid, global const uchar *blocks, int width, int height,
                  int x, int y, float dx, float dy)
{
    const int across = (width + SKIP_BLOCK - 1) / SKIP_BLOCK;
    const float edge_x = dx > 0.0f ? SKIP_BLOCK - 1 + SKIP_BLOCK_EDGE : -SKIP_BLOCK_EDGE, steps_per_x = 1.0f / fabs(dx);
    const float edge_y = dy > 0.0f ? SKIP_BLOCK - 1 + SKIP_BLOCK_EDGE : -SKIP_BLOCK_EDGE, steps_per_y = 1.0f / fabs(dy);
    for (int step = 1, longest = max(width, height); step < longest;) { /* a step goes a pixel along the longer axis */
        const int px = convert_int_rte(x + step * dx), py = convert_int_rte(y + step * dy);
        if (px < 0 || px >= width || py < 0 || py >= height)
            return 0.0f;
        if (valid[py * width + px])
            return depth[py * width + px];
        step++;
        if (!blocks[(py / SKIP_BLOCK) * across + px / SKIP_BLOCK]) { /* to the last step before the line leaves the block */
            const float to_x = fabs(px / SKIP_BLOCK * SKIP_BLOCK + edge_x - x) * steps_per_x;
            const float to_y = fabs(py / SKIP_BLOCK * SKIP_BLOCK + edge_y - y) * steps_per_y;
            step = max(step, (int)fmin(to_x, to_y));
        }
    }
    return 0.0f;
}

kernel void behind_lines(global const float *depth, global const uchar *valid, global const uchar *blocks,
                         global float *behind, int width, int height, int pitch, int run, float epipole_x,
                         float epipole_y, float epipole_w)
{
    const int first = get_global_id(0) * run, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + run, width); x++) {
        if (valid[y * width + x] || !is_edge(valid, width, height, x, y))
            continue;
        float dx = x * epipole_w - epipole_x, dy = y * epipole_w - epipole_y;
        const float longest = fmax(fabs(dx), fabs(dy));
        dx = longest > 0.0f ? dx / longest : 1.0f;
        dy = longest > 0.0f ? dy / longest : 0.0f;
        const float za = depth_along(depth, valid, blocks, width, height, x, y, dx, dy);
        const float zb = depth_along(depth, valid, blocks, width, height, x, y, -dx, -dy);
        behind[(size_t)(y + HALO) * pitch + x + HALO] = fmax(za, zb);
    }
}
