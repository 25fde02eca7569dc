/* Things one sample thin, as wide as the samples that saw them: wires, leaves, bars.
 *
 * The surface of lib/surface.h ends at its last samples: what is one sample wide has no triangles, or single ones. A
 * sample is thin if no cell around it is whole. It is drawn as a square of one sample's side that is swept, straight, to
 * each neighbour that it is not torn from (a ribbon), or that stays where it is if there is none (a dot); to a neighbour
 * that is not thin, up to the middle of that one. A ribbon is a plane: its nearness changes along it alone. Wires that run
 * aslant are seen as runs along rows (or columns) with steps of one sample between them; the middles of the squares lie
 * half a sample towards the next run where a run ends, and less the nearer to its middle: on the straight line, if the
 * wire is one.
 *
 * Three launches, as of forward.cl: the nearest ribbon of each pixel by nearness, of equally near ones the first by its
 * number, and then the pixels, where a ribbon is nearer than what is there or there is nothing. Where a ray meets a hidden
 * side first, a ribbon behind that shows.
 * keys: (dst_height, dst_width) nearness as warp/keys.h orders it, 0 where no ribbon is; indices: the same shape, 9 times
 * the number of the ribbon's thin sample and its way, 0 to 8 by rows to a neighbour, 4 to itself.
 * Work-item: STRIP * LANES samples, or pixels, of a row. Cost: O(samples + pixels of ribbons); a middle reads up to
 * 4 LONGEST samples. Determinism: maximum and minimum do not depend on the order of work-items.
 * Not in the paper, whose samples are all connected.
 */
#include "warp/cells.h"

#include "lib/channel.h"
#include "warp/keys.h"

/* Two launches must find the same nearness to the last bit. */
#pragma OPENCL FP_CONTRACT OFF

#ifndef STRIP
#define STRIP 1 /* packets of LANES samples, or pixels, that a work-item goes through: starting one takes longer than most */
#endif
#ifndef ORIGINS
#define ORIGINS 0 /* 1: where pixels come from is written, too */
#endif
#define LONGEST 32 /* samples of a run to either side that are looked at: it is straight to a sixtieth if it is longer */
#define WIDEST 256 /* target pixels: a ribbon's box is drawn no wider, as of one right before the target */
#define NONE 0xFFFFFFFFu
#define HELD_BACK 1024u /* of the least differences of nearness: the half squares beyond a ribbon's middles are behind what
                           goes on there in the same plane, whose colours run on */

/* A ribbon from the middle of one sample to that of another. */
typedef struct {
    float x, y;        /* the first middle */
    float dx, dy;      /* to the second one; 0 of a dot */
    float n, gu, gv;   /* nearness at the first middle, and its change */
    int ends;          /* at the second middle, without half a square beyond */
    int from, to;      /* the samples' numbers, y * width + x */
} Ribbon;

float sample_at(Grid grid, int x, int y)
{
    const int is_inside = x >= 0 && y >= 0 && x < grid.width && y < grid.height;
    return is_inside ? grid.nearness[(size_t)y * grid.pitch + x] : NO_SURFACE;
}

int joined(Grid grid, int ax, int ay, int bx, int by)
{
    const float a = sample_at(grid, ax, ay), b = sample_at(grid, bx, by);
    return !IS_OPEN(grid.cut, fmax(a, b), fmin(a, b));
}

int is_thin(Grid grid, int x, int y)
{
    for (int cell = 0; cell < 4; cell++) {
        const int dx = cell & 1 ? 1 : -1, dy = cell & 2 ? 1 : -1;
        const float n = sample_at(grid, x, y), a = sample_at(grid, x + dx, y), b = sample_at(grid, x, y + dy),
                    c = sample_at(grid, x + dx, y + dy);
        if (!IS_OPEN(grid.cut, fmax(fmax(n, a), fmax(b, c)), fmin(fmin(n, a), fmin(b, c))))
            return 0;
    }
    return 1;
}

/* The end of the run through (x, y) along (dx, dy): x: how far it is; y: 1 or -1, if the run goes on one sample aside. */
float2 run_end(Grid grid, int x, int y, int dx, int dy)
{
    const int aside_x = abs(dy), aside_y = abs(dx);
    for (int i = 0; i < LONGEST; i++, x += dx, y += dy) {
        if (joined(grid, x, y, x + dx, y + dy))
            continue;
        float step = 0.0f, reach = i + 0.5f;
        for (int side = -1; side <= 1; side += 2) {
            const int bx = x + side * aside_x, by = y + side * aside_y; /* beside the last sample, */
            if (!joined(grid, x, y, bx + dx, by + dy))                  /* and where the next run goes on */
                continue;
            step += side;
            if (joined(grid, x, y, bx, by) && joined(grid, bx, by, bx + dx, by + dy))
                reach = i; /* the runs overlap by a sample */
        }
        return (float2)(reach, step);
    }
    return (float2)(LONGEST, 0.0f);
}

/* Where the middle of the wire lies at sample (x, y). */
float2 middle_of(Grid grid, int x, int y)
{
    const float2 left = run_end(grid, x, y, -1, 0), right = run_end(grid, x, y, 1, 0);
    const float2 up = run_end(grid, x, y, 0, -1), down = run_end(grid, x, y, 0, 1);
    const int along_x = left.x + right.x >= up.x + down.x;
    const float2 a = along_x ? left : up, b = along_x ? right : down;
    const float per_half = 2.0f / fmax(a.x + b.x, 0.5f);
    const float aside = 0.5f * (a.y * fmax(1.0f - a.x * per_half, 0.0f) + b.y * fmax(1.0f - b.x * per_half, 0.0f));
    return along_x ? (float2)(x, y + aside) : (float2)(x + aside, y);
}

/* Is there a ribbon from thin sample (x, y) that way? Not if a corner of others leads there. */
int leads(Grid grid, int x, int y, int dx, int dy)
{
    if (!joined(grid, x, y, x + dx, y + dy))
        return 0;
    if (dx == 0 || dy == 0)
        return 1;
    return !(joined(grid, x, y, x + dx, y) && joined(grid, x + dx, y, x + dx, y + dy)) &&
           !(joined(grid, x, y, x, y + dy) && joined(grid, x, y + dy, x + dx, y + dy));
}

Ribbon ribbon_of(Grid grid, int x, int y, int way)
{
    const int there_x = x + way % 3 - 1, there_y = y + way / 3 - 1;
    const float2 middle = middle_of(grid, x, y);
    Ribbon ribbon = {middle.x, middle.y, 0.0f, 0.0f, sample_at(grid, x, y), 0.0f, 0.0f, 0, y * grid.width + x, 0};
    ribbon.to = there_y * grid.width + there_x;
    if (way == 4)
        return ribbon;
    ribbon.ends = !is_thin(grid, there_x, there_y);
    const float2 there = ribbon.ends ? (float2)(there_x, there_y) : middle_of(grid, there_x, there_y);
    ribbon.dx = there.x - middle.x;
    ribbon.dy = there.y - middle.y;
    const float squared = ribbon.dx * ribbon.dx + ribbon.dy * ribbon.dy;
    const float slope = squared > 1e-6f ? (sample_at(grid, there_x, there_y) - ribbon.n) / squared : 0.0f;
    ribbon.gu = slope * ribbon.dx;
    ribbon.gv = slope * ribbon.dy;
    return ribbon;
}

/* Narrows [*low, *high], the parts of the way at which the square holds a point p away from where it began, by an axis. */
void narrow(float p, float d, float *low, float *high)
{
    if (fabs(d) > 1e-6f) {
        const float a = (p - 0.5f) / d, b = (p + 0.5f) / d;
        *low = fmax(*low, fmin(a, b));
        *high = fmin(*high, fmax(a, b));
    } else if (!(fabs(p) <= 0.5f)) {
        *high = -1.0f;
    }
}

/* The target's nearness where a pixel's ray meets a ribbon, or EMPTY; part: where along it, below 0 or above 1 beyond its
 * middles. */
float meet_ribbon(Ribbon ribbon, PixelMap map, int shown, int column, int row, float *part)
{
    const float *S = map.src_from_dst;
    const float u = PIXEL_ROW(S, 0, column, row), v = PIXEL_ROW(S, 1, column, row), w = PIXEL_ROW(S, 2, column, row);
    const float at_start = PIXEL_ROW(S, 3, column, row) - ribbon.n * w - ribbon.gu * (u - ribbon.x * w) - ribbon.gv * (v - ribbon.y * w);
    const float per_unit = S[15] - ribbon.n * S[11] - ribbon.gu * (S[3] - ribbon.x * S[11]) - ribbon.gv * (S[7] - ribbon.y * S[11]);
    const float met = -at_start / per_unit, w_met = w + met * S[11];
    const float2 p = (float2)((u + met * S[3]) / w_met - ribbon.x, (v + met * S[7]) / w_met - ribbon.y);
    float low = 0.0f, high = 1.0f;
    narrow(p.x, ribbon.dx, &low, &high);
    narrow(p.y, ribbon.dy, &low, &high);
    *part = (p.x * ribbon.dx + p.y * ribbon.dy) / fmax(ribbon.dx * ribbon.dx + ribbon.dy * ribbon.dy, 1e-6f);
    const int is_on = low <= high && !(ribbon.ends && *part > 1.0f) && w_met > 0.0f;
    const int shows = (per_unit > 0.0f && (shown & SHOWS_FRONT)) || (per_unit < 0.0f && (shown & SHOWS_BACK));
    return is_on && shows && IS_BEFORE(map.dst_perspective, met) ? met : EMPTY;
}

/* Puts a ribbon's nearness into keys; with indices, its number there, where it is what the keys hold. */
void draw_ribbon(Ribbon ribbon, PixelMap map, int shown, uint number, global uint *keys, global uint *indices)
{
    const float *D = map.dst_from_src;
    float low_u = INFINITY, low_v = INFINITY, high_u = -INFINITY, high_v = -INFINITY;
    for (int i = 0; i < 8; i++) { /* corners of the squares at both ends */
        const float dx = (i & 1 ? 0.5f : -0.5f) + (i & 4 ? ribbon.dx : 0.0f), dy = (i & 2 ? 0.5f : -0.5f) + (i & 4 ? ribbon.dy : 0.0f);
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
    const int right = min(convert_int_sat(floor(clamp(high_u, -1.0f, map.dst_width - 1.0f))), left + WIDEST);
    const int bottom = min(convert_int_sat(floor(clamp(high_v, -1.0f, map.dst_height - 1.0f))), top + WIDEST);
    for (int row = top; row <= bottom; row++)
        for (int column = left; column <= right; column++) {
            float part;
            const float met = meet_ribbon(ribbon, map, shown, column, row, &part);
            if (!IS_HIT(met))
                continue;
            const int at = row * map.dst_width + column;
            const uint key = key_of(met) - (part < 0.0f || part > 1.0f ? HELD_BACK : 0u);
            if (!indices)
                atomic_max(keys + at, key);
            else if (keys[at] == key)
                atomic_min(indices + at, number);
        }
}

/* Draws what a thin sample begins: its ribbons to others, each of two thin ones by the first of them. */
void draw_sample(Grid grid, PixelMap map, int shown, int x, int y, global uint *keys, global uint *indices)
{
    int alone = 1;
    const uint first = 9u * (y * map.src_width + x);
    for (int way = 0; way < 9; way++) {
        const int dx = way % 3 - 1, dy = way / 3 - 1;
        if (way == 4 || !leads(grid, x, y, dx, dy))
            continue;
        alone = 0;
        if (way > 4 || !is_thin(grid, x + dx, y + dy))
            draw_ribbon(ribbon_of(grid, x, y, way), map, shown, first + way, keys, indices);
    }
    if (alone)
        draw_ribbon(ribbon_of(grid, x, y, 4), map, shown, first + 4, keys, indices);
}

/* A row's LANES samples from x0 on, and their neighbours to the left and to the right; no surface beyond the image. */
INLINED void load_row(Grid grid, int x0, int y, floatl *left, floatl *here, floatl *right)
{
    const intl x = x0 + lane_index;
    *left = *here = *right = NO_SURFACE;
    if (y < 0 || y >= grid.height)
        return;
    global const float *own = grid.nearness + (size_t)y * grid.pitch + x0;
    *here = pick(x < grid.width, load_lanes(own), (floatl)NO_SURFACE);
    *right = pick(x + 1 < grid.width, load_lanes(own + 1), (floatl)NO_SURFACE); /* rows have room to look beyond */
    *left = shifted_lanes(*here);
    set_float_lane(*left, 0, x0 > 0 ? own[-1] : NO_SURFACE);
}

#define IS_TORN(a, b, c, d)                                                                                    \
    IS_OPEN(grid.cut, greater(greater(a, b), greater(c, d)), lesser(lesser(a, b), lesser(c, d)))

/* Draws the thin ones of a work-item's samples. */
void draw_strip(global const float *nearness, global uint *keys, global uint *indices, PixelMap map, Cut cut, int shown)
{
    const int y = get_global_id(1);
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
    if (y >= grid.height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < grid.width; x0 += LANES, packet++) {
        floatl left[3], here[3], right[3];
        for (int i = 0; i < 3; i++)
            load_row(grid, x0, y + i - 1, left + i, here + i, right + i);
        const intl thin = (here[1] > NO_SURFACE) & IS_TORN(left[0], here[0], left[1], here[1]) &
                          IS_TORN(right[0], here[0], right[1], here[1]) & IS_TORN(left[2], here[2], left[1], here[1]) &
                          IS_TORN(right[2], here[2], right[1], here[1]);
        if (!any_lane(thin))
            continue; /* as most */
        for (int lane = 0; lane < LANES; lane++)
            if (int_lane(thin, lane))
                draw_sample(grid, map, shown, x0 + lane, y, keys, indices);
    }
}

kernel void thin_nearness(global const float *nearness, global uint *keys, PixelMap map, Cut cut, int shown)
{
    draw_strip(nearness, keys, 0, map, cut, shown);
}

kernel void thin_index(global const float *nearness, global uint *keys, global uint *indices, PixelMap map, Cut cut, int shown)
{
    draw_strip(nearness, keys, indices, map, cut, shown);
}

/* The colours of samples a and b, mixed */
void mix_colors(global const channel *src_color, int a, int b, float part, global channel *color)
{
    for (int c = 0; c < CHANNELS; c++) {
        const float from = src_color[CHANNELS * (size_t)a + c], to = src_color[CHANNELS * (size_t)b + c];
        color[c] = to_channel(from + part * (to - from));
    }
}

/* Pixel (x, y) is that of a ribbon, if it is nearer than what is there. */
void write_ribbon(Grid grid, uint number, PixelMap map, int shown, int linear, int x, int y, global const channel *src_color,
                  global float *depth, global channel *color, global uchar *valid, global float *origin, int view)
{
    const float *D = map.dst_from_src;
    const int sample = number / 9;
    const Ribbon ribbon = ribbon_of(grid, sample % grid.width, sample / grid.width, number % 9);
    float part, met = meet_ribbon(ribbon, map, shown, x, y, &part);
    const int nearest = part > 0.5f ? ribbon.to : ribbon.from, sx = nearest % grid.width, sy = nearest / grid.width;
    part = clamp(part, 0.0f, 1.0f);
    if (!linear) {
        part = part > 0.5f;
        const float q = sample_at(grid, sx, sy), w = MAP_ROW(D, 2, sx, sy, q);
        met = w > 0.0f ? MAP_ROW(D, 3, sx, sy, q) / w : met;
    }
    const float z = DEPTH_OF(map.dst_perspective, met);
    if (!IS_HIT(met) || !IS_BEFORE(map.dst_perspective, met) || (*valid && z >= *depth))
        return;
    *depth = z;
    *valid = 1;
    mix_colors(src_color, ribbon.from, ribbon.to, part, color);
#if ORIGINS
    vstore3((float3)(sx, sy, view), 0, origin); /* what lies beside a wire is another thing's */
#endif
}

kernel void thin_pixels(global const float *nearness, global const uint *keys, global const uint *indices,
                        global const channel *src_color, global float *depth, global channel *color, global uchar *valid,
                        PixelMap map, Cut cut, int shown, int linear
#if ORIGINS
                        ,
                        global float *origin /* (dst_height, dst_width, 3): u, v and the number of the view */, int view
#endif
)
{
    const int y = get_global_id(1);
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
    if (y >= map.dst_height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < map.dst_width; x0 += LANES, packet++) {
        const size_t at = (size_t)y * map.dst_width + x0;
        if (x0 + LANES <= map.dst_width && !any_lane(as_intl(load_lanes(keys + at)) != 0))
            continue; /* as most */
        for (int i = 0; i < min(LANES, map.dst_width - x0); i++)
            if (keys[at + i] && indices[at + i] != NONE)
                write_ribbon(grid, indices[at + i], map, shown, linear, x0 + i, y, src_color, depth + at + i,
                             color + CHANNELS * (at + i), valid + at + i,
#if ORIGINS
                             origin + 3 * (at + i), view
#else
                             0, 0
#endif
                );
    }
}
