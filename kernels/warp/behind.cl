/* What lies behind holes, told along the epipolar lines that opened them: a disocclusion lies on its line between the
 * edge of what hid it and the background that it belongs to, so of the two seen pixels at its ends the farther one is
 * background, the nearer one foreground. Half-way between their depths begins what lies behind the hole.
 *
 * A line goes from a hole in steps of a pixel along its longer axis; each step is at the nearest pixel. Where it is the
 * same through all of its pixels, along rows, columns or diagonals, the holes between two ends are written at once
 * (behind_runs). Elsewhere each hole searches for its own ends (behind_lines), and crosses blocks of holes in large
 * steps; only holes beside valid pixels do, since fill.cl needs no others.
 *
 * depth, valid: (height, width). behind: holes.h, rows of `pitch`, written in holes alone: the depth from which on
 * pixels beside them are background; 0 where all are. blocks: SKIP_BLOCK x SKIP_BLOCK pixels each, whether any of them
 * is valid. epipole: lines lead away from it, and foreground hides what is further along; all 0: they are the rows.
 * dx, dy: -1, 0 or 1, a step along all lines, down or, along rows, right; hides: 1 where foreground hides what comes
 * after it along that step, -1 what comes before it, 0 where nothing moves with its depth. map: the view's; same: how
 * far apart two pixels of one surface may be.
 * Work-item: one block (behind_blocks); 64 * `strip` pixels of a row, and the holes of all lines that begin in them
 * (behind_runs); `run` pixels of a row (behind_lines). Cost: behind_runs O(pixels), behind_lines O(pixels + holes
 * beside valid pixels * hole's length), of which whole blocks count once. Determinism: no pixel that is written is
 * read.
 */
#include "lib/pixelspace.h"
#include "warp/holes.h"

#define SKIP_BLOCK 32
#define LOOK_EVERY 8 /* steps: a line looks so often whether it is in a block of holes */
#define SKIP_BLOCK_EDGE 0.49f /* pixels from a block's outermost centres to its edge, less what rounding moves by */

/* How far apart in depth two pixels of one surface may be: same_2 z^2 + same_1 z + same_0 at depth z */
typedef struct {
    float same_2, same_1, same_0;
} Same;

#define SAME(same, z) (((same).same_2 * (z) + (same).same_1) * (z) + (same).same_0)

/* The depth from which on what is beside a hole lies behind it, whose line ends at depths a and b */
float behind_of(Same same, float a, float b)
{
    const float far = fmax(a, b), near = fmin(a, b);
    return far - near > SAME(same, far) ? 0.5f * (far + near) : 0.0f;
}

/* The same of a line of which one end alone is in the picture, at depth z; (x, y): the hole beside it. If the end
 * is the nearer one, its surface is torn off there, unless it goes on beyond the border of the source's image. */
float behind_one(Same same, PixelMap map, int x, int y, float z, int is_near)
{
    const float *m = map.src_from_dst, n = DEPTH_OF(map.dst_perspective, z), w = MAP_ROW(m, 2, x, y, n);
    const float u = MAP_ROW(m, 0, x, y, n) / w, v = MAP_ROW(m, 1, x, y, n) / w;
    const int inside = w > 0.0f && u > -0.5f && v > -0.5f && u < map.src_width - 0.5f && v < map.src_height - 0.5f;
    return is_near && inside ? z + SAME(same, z) : 0.0f;
}

/* The holes of the lines that begin in 64 pixels of a row; begins: the first hole of each, as bits */
void follow_runs(global const float *depth, global const uchar *valid, global float *behind, int width, int height,
                 int pitch, int dx, int dy, int hides, Same same, const PixelMap *map, int x0, int y0, ulong begins)
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
        const float after = is_inside ? depth[pixel] : 0.0f;
        float limit;
        if (before != 0.0f && after != 0.0f)
            limit = behind_of(same, before, after);
        else if (before != 0.0f)
            limit = behind_one(same, *map, first, y0, before, hides > 0);
        else
            limit = after != 0.0f ? behind_one(same, *map, x - dx, y - dy, after, hides < 0) : 0.0f;
        global float *out = behind + (size_t)(y0 + HALO) * pitch + first + HALO;
        for (int i = 0; i < length; i++)
            out[i * (dy * pitch + dx)] = limit;
    }
}

kernel void behind_runs(global const float *depth, global const uchar *valid, global float *behind, int width,
                        int height, int pitch, int strip, int dx, int dy, int hides, Same same, PixelMap map)
{
    const int first = get_global_id(0) * 64 * strip, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + 64 * strip, width); x += 64) {
        const ulong holes = hole_bits(valid, width, height, x, y, 8);
        if (holes)
            follow_runs(depth, valid, behind, width, height, pitch, dx, dy, hides, same, &map, x, y,
                        holes & ~hole_bits(valid, width, height, x - dx, y - dy, 8));
    }
}

kernel void behind_blocks(global const uchar *valid, global uchar *blocks, int width, int height)
{
    const int bx = get_global_id(0), by = get_global_id(1);
    const int across = (width + SKIP_BLOCK - 1) / SKIP_BLOCK;
    if (bx >= across || by * SKIP_BLOCK >= height)
        return;
    const ulong columns = ~0ul >> (64 - min(SKIP_BLOCK, width - bx * SKIP_BLOCK));
    ulong holes = columns;
    for (int y = by * SKIP_BLOCK; y < min((by + 1) * SKIP_BLOCK, height); y++)
        holes &= hole_bits(valid, width, height, bx * SKIP_BLOCK, y, SKIP_BLOCK / 8);
    blocks[by * across + bx] = holes != columns;
}

/* Beside a valid pixel */
int is_edge(global const uchar *valid, int width, int height, int x, int y)
{
    uchar any = 0;
    for (int v = max(y - 1, 0); v <= min(y + 1, height - 1); v++)
        for (int u = max(x - 1, 0); u <= min(x + 1, width - 1); u++)
            any |= valid[v * width + u];
    return any;
}

/* The depth of the first valid pixel from (x, y) along (dx, dy), or 0; *steps: how many steps away it is */
float depth_along(global const float *depth, global const uchar *valid, global const uchar *blocks, int width,
                  int height, int x, int y, float dx, float dy, int *steps)
{
    const int across = (width + SKIP_BLOCK - 1) / SKIP_BLOCK;
    const float edge_x = dx > 0.0f ? SKIP_BLOCK - 1 + SKIP_BLOCK_EDGE : -SKIP_BLOCK_EDGE, steps_per_x = 1.0f / fabs(dx);
    const float edge_y = dy > 0.0f ? SKIP_BLOCK - 1 + SKIP_BLOCK_EDGE : -SKIP_BLOCK_EDGE, steps_per_y = 1.0f / fabs(dy);
    for (int step = 1, longest = max(width, height); step < longest;) { /* a step goes a pixel along the longer axis */
        const int px = convert_int_rte(x + step * dx), py = convert_int_rte(y + step * dy);
        if (px < 0 || px >= width || py < 0 || py >= height)
            return 0.0f;
        if (valid[py * width + px]) {
            *steps = step;
            return depth[py * width + px];
        }
        step++;
        if (step % LOOK_EVERY == 0 && !blocks[(py / SKIP_BLOCK) * across + px / SKIP_BLOCK]) {
            /* to the last step before the line leaves the block */
            const float to_x = fabs(px / SKIP_BLOCK * SKIP_BLOCK + edge_x - x) * steps_per_x;
            const float to_y = fabs(py / SKIP_BLOCK * SKIP_BLOCK + edge_y - y) * steps_per_y;
            step = max(step, (int)fmin(to_x, to_y));
        }
    }
    return 0.0f;
}

kernel void behind_lines(global const float *depth, global const uchar *valid, global const uchar *blocks,
                         global float *behind, int width, int height, int pitch, int run, float epipole_x,
                         float epipole_y, float epipole_w, Same same, PixelMap map)
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
        int steps = 0;
        const float after = depth_along(depth, valid, blocks, width, height, x, y, dx, dy, &steps);
        const float before = depth_along(depth, valid, blocks, width, height, x, y, -dx, -dy, &steps);
        float limit = 0.0f;
        if (before != 0.0f && after != 0.0f)
            limit = behind_of(same, before, after);
        else if (before != 0.0f) {
            const int u = convert_int_rte(x - (steps - 1) * dx), v = convert_int_rte(y - (steps - 1) * dy);
            limit = behind_one(same, map, u, v, before, longest > 0.0f);
        }
        behind[(size_t)(y + HALO) * pitch + x + HALO] = limit;
    }
}
