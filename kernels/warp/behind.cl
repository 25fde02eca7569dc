/* Finds the depth behind holes along epipolar lines. On such a line, a disocclusion (a run of hole pixels) lies between
 * the edge of the occluding surface and the background. So of the two valid pixels at the ends of the run, the farther
 * one gives the depth behind the hole, and the nearer one is foreground.
 *
 * But in a wide hole, the sides of the occluding object would also be seen, and they look like its front. So the nearer
 * end only counts as foreground if the hole is narrow in the picture, or if both surfaces are flat: continued into the
 * hole, they would not meet. In both cases, the two ends' depths must differ by more than `same`. Each condition sets
 * in gradually, so that sequences do not flicker.
 *
 * The search for an end moves by one pixel at a time along the line's longer axis, and reads the nearest pixel. Lines
 * along rows, columns or diagonals pass through the same pixels for each hole on them, so the holes between two ends
 * are written together (behind_runs). For other directions, each hole pixel searches for its own two ends and crosses
 * blocks of holes in large steps (behind_lines). Only holes next to valid pixels or at the border search, since fill.cl
 * reads no others.
 *
 * depth, valid: (height, width). behind: holes.h, written in holes alone. Its first plane is the depth behind the
 * holes, 0 if neither direction of the line leads to a valid pixel. The second plane is the falloff, per unit of depth:
 * if a pixel next to the hole is nearer than the depth behind the hole by d, the fraction falloff * d of it counts as
 * foreground. blocks: a byte for each block of SKIP_BLOCK x SKIP_BLOCK pixels: 1 if any of them is valid. epipole: all
 * lines lead away from it; if its components are all 0, lines are rows. dx, dy: -1, 0 or 1, the step along all lines:
 * to the row below or, in rows, to the right. same: the depth by which pixels of one surface may differ. Work-item: one
 * block (behind_blocks); 64 * `strip` pixels of a row, and the whole runs of holes that begin in them (behind_runs);
 * `run` pixels of a row (behind_lines). Cost: behind_runs O(pixels), behind_lines O(pixels + hole's length * holes next
 * to valid pixels); a block of holes counts as one pixel of this length. Determinism: no kernel reads its own output.
 */
#include "lib/pixelspace.h"
#include "warp/holes.h"

#define SKIP_BLOCK 32
#define LOOK_EVERY 8 /* after this many steps, a search tests whether it is in a block of holes */
#define SKIP_BLOCK_EDGE 0.49f /* pixels between a block's edge and the centre of its outermost pixel, rounded down */
#define NARROW_HOLE 0.02f /* fraction of the picture's longer side: shorter holes are narrow, */
#define WIDE_HOLE 0.035f  /* and longer holes are wide */
#define OUTWARD 8         /* slopes are measured from a hole's ends outwards, over 1/8 of the hole's length */
/* Change of a surface's nearness across the hole, as a fraction of the difference between the ends: below FLAT the
 * surface is flat, above SLOPING it slopes. */
#define FLAT 0.05f
#define SLOPING 0.15f

/* The depth by which two pixels of one surface may differ: same_2 z^2 + same_1 z + same_0 at depth z */
typedef struct {
    float same_2, same_1, same_0;
} Same;

/* The first valid pixel in one direction from a hole: its depth, and its distance in steps; both 0 if there is none */
typedef struct {
    float depth;
    int steps;
} End;

/* Rises smoothly from 0, for values up to `from`, to 1, for values from `to` on. */
float rising(float from, float to, float value)
{
    const float part = clamp((value - from) / (to - from), 0.0f, 1.0f);
    return part * part * (3.0f - 2.0f * part);
}

/* The depth of the pixel nearest to a place; 0 if it is invalid or outside of the picture */
float depth_at(global const float *depth, global const uchar *valid, int width, int height, float2 place)
{
    const int x = convert_int_rte(place.x), y = convert_int_rte(place.y);
    return x >= 0 && y >= 0 && x < width && y < height && valid[y * width + x] ? depth[y * width + x] : 0.0f;
}

/* The falloff of the holes between valid pixels a and b, which have depths z_a and z_b and are `length` steps apart */
float falloff_of(global const float *depth, global const uchar *valid, int width, int height, Same same,
                 int perspective, float2 a, float z_a, float2 b, float z_b, float2 step, int length)
{
    const float far = fmax(z_a, z_b), gap = far - fmin(z_a, z_b);
    const float differ = rising(1.0f, 2.0f, gap / ((same.same_2 * far + same.same_1) * far + same.same_0));
    if (differ == 0.0f)
        return 0.0f;
    float sure = 1.0f - rising(NARROW_HOLE, WIDE_HOLE, length * fast_length(step) / max(width, height));
    if (sure < 1.0f) {
        const int out = max(length / OUTWARD, 1);
        const float out_a = depth_at(depth, valid, width, height, a - out * step);
        const float out_b = depth_at(depth, valid, width, height, b + out * step);
        if (out_a != 0.0f && out_b != 0.0f) {
            const float n_a = DEPTH_OF(perspective, z_a), n_b = DEPTH_OF(perspective, z_b);
            const float change = fabs(n_a - DEPTH_OF(perspective, out_a)) + fabs(n_b - DEPTH_OF(perspective, out_b));
            sure = fmax(sure, 1.0f - rising(FLAT, SLOPING, change * length / (out * fabs(n_a - n_b))));
        }
    }
    return differ * sure / gap;
}

/* Writes the runs of holes that begin in 64 pixels of a row. begins: a bit is set where a run begins. */
void follow_runs(global const float *depth, global const uchar *valid, global float *behind, int width, int height,
                 int pitch, int perspective, Same same, int dx, int dy, int x0, int y0, ulong begins)
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
        float falloff = 0.0f;
        if (before != 0.0f && after != 0.0f)
            falloff = falloff_of(depth, valid, width, height, same, perspective, (float2)(first - dx, y0 - dy), before,
                                 (float2)(x, y), after, (float2)(dx, dy), length + 1);
        global float *out = behind + (size_t)(y0 + HALO) * pitch + first + HALO;
        for (int i = 0; i < length; i++) {
            out[i * (dy * pitch + dx)] = fmax(before, after);
            out[BEHIND_PLANE(height, pitch) + i * (dy * pitch + dx)] = falloff;
        }
    }
}

kernel void behind_runs(global const float *depth, global const uchar *valid, global float *behind, int width,
                        int height, int pitch, int perspective, int strip, int dx, int dy, Same same)
{
    const int first = get_global_id(0) * 64 * strip, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + 64 * strip, width); x += 64) {
        const ulong holes = hole_bits(valid, width, height, x, y, 8);
        if (holes)
            follow_runs(depth, valid, behind, width, height, pitch, perspective, same, dx, dy, x, y,
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

/* Is the hole (x, y) next to a valid pixel, or at the picture's border? */
int is_edge(global const uchar *valid, int width, int height, int x, int y)
{
    uchar any = x == 0 || y == 0 || x == width - 1 || y == height - 1;
    for (int v = max(y - 1, 0); v <= min(y + 1, height - 1); v++)
        for (int u = max(x - 1, 0); u <= min(x + 1, width - 1); u++)
            any |= valid[v * width + u];
    return any;
}

/* The first valid pixel from (x, y) on in the direction (dx, dy) */
End end_along(global const float *depth, global const uchar *valid, global const uchar *blocks, int width, int height,
              int x, int y, float dx, float dy)
{
    const int across = (width + SKIP_BLOCK - 1) / SKIP_BLOCK;
    const float edge_x = dx > 0.0f ? SKIP_BLOCK - 1 + SKIP_BLOCK_EDGE : -SKIP_BLOCK_EDGE, steps_per_x = 1.0f / fabs(dx);
    const float edge_y = dy > 0.0f ? SKIP_BLOCK - 1 + SKIP_BLOCK_EDGE : -SKIP_BLOCK_EDGE, steps_per_y = 1.0f / fabs(dy);
    for (int step = 1, longest = max(width, height); step < longest;) { /* a step goes a pixel along the longer axis */
        const int px = convert_int_rte(x + step * dx), py = convert_int_rte(y + step * dy);
        if (px < 0 || px >= width || py < 0 || py >= height)
            break;
        if (valid[py * width + px])
            return (End){depth[py * width + px], step};
        step++;
        if (step % LOOK_EVERY == 0 && !blocks[(py / SKIP_BLOCK) * across + px / SKIP_BLOCK]) {
            /* Go on at the last step before the line leaves the block. */
            const float to_x = fabs(px / SKIP_BLOCK * SKIP_BLOCK + edge_x - x) * steps_per_x;
            const float to_y = fabs(py / SKIP_BLOCK * SKIP_BLOCK + edge_y - y) * steps_per_y;
            step = max(step, (int)fmin(to_x, to_y));
        }
    }
    return (End){0.0f, 0};
}

kernel void behind_lines(global const float *depth, global const uchar *valid, global const uchar *blocks,
                         global float *behind, int width, int height, int pitch, int perspective, int run,
                         float epipole_x, float epipole_y, float epipole_w, Same same)
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
        const End a = end_along(depth, valid, blocks, width, height, x, y, -dx, -dy);
        const End b = end_along(depth, valid, blocks, width, height, x, y, dx, dy);
        float falloff = 0.0f;
        if (a.steps && b.steps) {
            const float2 here = (float2)(x, y), step = (float2)(dx, dy);
            falloff = falloff_of(depth, valid, width, height, same, perspective, here - a.steps * step, a.depth,
                                 here + b.steps * step, b.depth, step, a.steps + b.steps);
        }
        global float *to = behind + (size_t)(y + HALO) * pitch + x + HALO;
        to[0] = fmax(a.depth, b.depth);
        to[BEHIND_PLANE(height, pitch)] = falloff;
    }
}
