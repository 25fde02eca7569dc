/* Holes filled from around them by push and pull (Gortler, Grzeszczuk, Szeliski, Cohen: The Lumigraph, 1996, section
 * 3.4): valid pixels beside holes are averaged into ever coarser cells of a pyramid (push, pyramid.h), and each hole
 * takes from coarse levels what finer ones do not know (pull). So narrow holes are filled from close by and wide ones
 * from all around.
 *
 * With HAS_BEHIND a pixel weighs the less the nearer it is than what lies behind the holes beside it (behind.cl), so
 * that a disocclusion is filled from what was hidden, not from what hid it. But no weight is 0: where there is no
 * background far and wide, the foreground fills the hole.
 *
 * color, depth, valid: (height, width). behind: behind.cl. base, cells, inner: pyramid.h; the base of the lowest tiles
 * are the pixels. pull replaces the cells' colour and nearness by the filled ones. Work-item: a row of `strip` tiles
 * (pixels), or a tile (cells). Cost: O(pixels). Determinism: no pixel that is written is read, but by its own
 * work-item; sums run in a fixed order.
 */
#include "lib/channel.h"
#include "lib/pixelspace.h"
#include "warp/pyramid.h"

#define HALO_TILE 24          /* TILE + 2 * HALO */
#define BESIDE 1              /* pixels from a hole within which valid ones have a weight */
#define PIXEL_WEIGHT_MIN 1e-6f /* of any pixel: more than nothing */
#define RATIO_FLOOR 1e-3f     /* ratios up to it weigh nothing, so that half the depth of what lies behind leaves no trace */

#if CHANNELS == 3 && COLOR_BYTES == 1
#define to_channel16 convert_uchar16_sat_rte
#define channel16 uchar16
typedef struct __attribute__((packed)) {
    uchar16 bytes;
} SixteenBytes;
#define LOAD16(p) ((global const SixteenBytes *)(p))->bytes
#elif CHANNELS == 3
#define to_channel16(values) (values)
#define channel16 float16
#define LOAD16(p) vload16(0, p)
#endif

/* The colour of up to 16 pixels of a row; what is beyond them is whatever it is. */
INLINED void read_row(Row *row, global const channel *color, size_t pixel, int count)
{
    row->plane[0] = row->plane[1] = row->plane[2] = 0.0f;
#if CHANNELS == 3
    if (count == TILE) {
        global const channel *from = color + 3 * pixel;
        const channel16 a = LOAD16(from), b = LOAD16(from + 16), c = LOAD16(from + 32);
        row->plane[0] = convert_float16((channel16)(a.s0369, a.scf, b.s258b, b.se, c.s147a, c.sd));
        row->plane[1] = convert_float16((channel16)(a.s147a, a.sd, b.s0369, b.scf, c.s258b, c.se));
        row->plane[2] = convert_float16((channel16)(a.s258b, a.se, b.s147a, b.sd, c.s0369, c.scf));
        return;
    }
    float values[3][TILE];
    for (int i = 0; i < TILE; i++)
        for (int channel_ = 0; channel_ < 3; channel_++)
            values[channel_][i] = i < count ? (float)color[3 * (pixel + i) + channel_] : 0.0f;
    for (int channel_ = 0; channel_ < 3; channel_++)
        row->plane[channel_] = vload16(0, values[channel_]);
#endif
}

INLINED float16 row_depths(global const float *depth, size_t pixel, int count)
{
    if (count == TILE)
        return vload16(0, depth + pixel);
    float values[TILE];
    for (int i = 0; i < TILE; i++)
        values[i] = i < count ? depth[pixel + i] : 1.0f;
    return vload16(0, values);
}

#if HAS_BEHIND
/* The farthest depth behind the holes in the 12 x 12 pixels around each 4 x 4 pixels of a tile, as four rows. Only
 * holes beside what is none in the tile and its halo count: of others behind.cl may know nothing. */
INLINED void read_behind(global const float *behind, int pitch, const uint *bits, float16 *around)
{
    uint known[HALO_TILE];
    for (int v = 0; v < HALO_TILE; v++) {
        const uint valid = ~bits[v] & 0xffffffu;
        known[v] = valid | valid << 1 | valid >> 1;
    }
    float4 bands[HALO_TILE / 4];
    for (int band = 0; band < HALO_TILE / 4; band++) {
        float16 left = 0.0f, right = 0.0f; /* columns 0 to 15, and 8 to 23 */
        for (int v = 4 * band; v < 4 * band + 4; v++) {
            const uint edge = bits[v] & (known[max(v - 1, 0)] | known[v] | known[min(v + 1, HALO_TILE - 1)]);
            if (!edge)
                continue;
            const float16 one = MASKED(AMONG(edge), vload16(0, behind + v * pitch));
            const float16 other = MASKED(AMONG(edge >> 8), vload16(0, behind + v * pitch + 8));
            left = left > one ? left : one;
            right = right > other ? right : other;
        }
        const float8 left_pairs = fmax(left.even, left.odd), right_pairs = fmax(right.even, right.odd);
        const float4 low = fmax(left_pairs.even, left_pairs.odd), high = fmax(right_pairs.even, right_pairs.odd);
        bands[band] = fmax(fmax(low, high), (float4)(low.yzw, high.z));
    }
    for (int i = 0; i < 4; i++)
        around[i] = fmax(fmax(bands[i], bands[i + 1]), bands[i + 2]).xxxxyyyyzzzzwwww;
}

/* The weights of pixels of depths z */
INLINED float16 weights_of(float16 z, float16 around)
{
    float16 ratio = around > z ? z / around : (float16)1.0f;
    ratio *= ratio;
    ratio *= ratio;
    ratio *= ratio * ratio; /* to the 12th power */
    ratio += RATIO_FLOOR * (ratio - 1.0f);
    return ratio > PIXEL_WEIGHT_MIN ? ratio : (float16)PIXEL_WEIGHT_MIN;
}
#endif

void push_tile(global const channel *color, global const float *depth, global const uchar *valid,
               global const float *behind, int width, int height, int pitch, int perspective, int column, int row,
               int tile, int tiles, global float *inner, global float *cells)
{
    const int tile_x = column * TILE, tile_y = row * TILE, count = min(TILE, width - tile_x);
    uint bits[HALO_TILE], beside[TILE], any = 0;
    for (int v = HALO - BESIDE; v < HALO + TILE + BESIDE; v++)
        bits[v] = hole_bits(valid, width, height, tile_x - HALO, tile_y + v - HALO, HALO_TILE / 8);
    for (int y = 0; y < TILE; y++) {
        const uint *here = bits + y + HALO;
        uint near = here[-1] | here[0] | here[1];
        near |= near << 1 | near >> 1;
        beside[y] = tile_y + y < height ? (near & ~here[0]) >> HALO & (0xffffu >> (TILE - count)) : 0u;
        any |= beside[y];
    }
    if (!any) {
        clear_tile(tile, tiles, cells);
        return;
    }
#if HAS_BEHIND
    for (int v = 0; v < HALO_TILE; v++)
        if (v < HALO - BESIDE || v >= HALO + TILE + BESIDE)
            bits[v] = hole_bits(valid, width, height, tile_x - HALO, tile_y + v - HALO, HALO_TILE / 8);
    float16 around[4];
    read_behind(behind + (size_t)tile_y * pitch + tile_x, pitch, bits, around);
#endif
    Levels made, *levels = &made;
    for (int y = 0; y < TILE / 2; y++) {
        if (!(beside[2 * y] | beside[2 * y + 1])) {
            for (int p = 0; p < PLANES; p++)
                levels->eight[p][y] = 0.0f;
            continue;
        }
        Row rows[2];
        for (int i = 0; i < 2; i++) {
            const int v = 2 * y + i;
            const size_t pixel = (size_t)(tile_y + v) * width + tile_x;
            if (!beside[v]) {
                for (int p = 0; p < PLANES; p++)
                    rows[i].plane[p] = 0.0f;
                continue;
            }
            read_row(&rows[i], color, pixel, count);
            const float16 z = row_depths(depth, pixel, count);
            rows[i].plane[3] = DEPTH_OF(perspective, z);
            float16 weights = 1.0f;
#if HAS_BEHIND
            weights = weights_of(z, around[v / 4]);
#endif
            const int16 mask = AMONG(beside[v]);
            for (int p = 0; p < WEIGHT_PLANE; p++)
                rows[i].plane[p] = MASKED(mask, weights * rows[i].plane[p]);
            rows[i].plane[WEIGHT_PLANE] = MASKED(mask, weights);
        }
        HALVE(float16, float8, EIGHT, ROW_16, 0)
    }
    write_levels(levels, 1, perspective, tile, tiles, inner, cells);
}

kernel void push_pixels(global const channel *color, global const float *depth, global const uchar *valid,
                        global const float *behind, int width, int height, int pitch, int perspective, int strip,
                        global float *inner, global float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int first = get_global_id(0) * strip, row = get_global_id(1);
    if (first >= across || row >= down)
        return;
    if (first == 0 && row == 0)
        clear_last(across * down, inner);
    for (int column = first; column < min(first + strip, across); column++)
        push_tile(color, depth, valid, behind, width, height, pitch, perspective, column, row, row * across + column,
                  across * down, inner, cells);
}

kernel void push_cells(global const float *base, int width, int height, int perspective, int level, global float *inner,
                       global float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int column = get_global_id(0), row = get_global_id(1);
    if (column >= across || row >= down)
        return;
    if (column == 0 && row == 0)
        clear_last(across * down, inner);
    Levels made, *levels = &made;
    for (int y = 0; y < TILE / 2; y++) {
        Row rows[2];
        for (int i = 0; i < 2; i++)
            for (int p = 0; p < PLANES; p++)
                for (int x = 0; x < TILE; x++) {
                    const int u = column * TILE + x, v = row * TILE + 2 * y + i;
                    const float value = u < width && v < height ? base[(p * height + v) * width + u] : 0.0f;
                    ((float *)&rows[i].plane[p])[x] = value;
                }
        HALVE(float16, float8, EIGHT, ROW_16, level)
    }
    write_levels(levels, level + 1, perspective, row * across + column, across * down, inner, cells);
}

#define PARTS_4 0.25f, 0.75f, 0.25f, 0.75f
#define PARTS_8 PARTS_4, PARTS_4
#define PARTS_16 PARTS_8, PARTS_8

/* Row y of a level, a cell beyond the tile being its first, is between these of the level above, */
#define ROW_BETWEEN(above, y) mix((above)[(y) / 2], (above)[(y) / 2 + 1], (y) & 1 ? 0.75f : 0.25f)
/* and its cells between those on the `left` and the `right` of them. */
#define CELLS_BETWEEN(type, row, left, right, ...) mix((row).left, (row).right, (type)(__VA_ARGS__))

/* What a level's row holds itself, with a cell beyond the tile on either side, from plane p of three tiles beside each
 * other. */
#define PLANE_OF(tile, p) inner + ((size_t)(tile) * PLANES + (p)) * INNER_CELLS
INLINED float4 own_two(global const float *inner, const int *tiles, int p, int y)
{
    global const float *left = PLANE_OF(tiles[0], p) + 80, *here = PLANE_OF(tiles[1], p) + 80;
    return (float4)(left[2 * y + 1], vload2(y, here), (PLANE_OF(tiles[2], p))[80 + 2 * y]);
}
INLINED float8 own_four(global const float *inner, const int *tiles, int p, int y)
{
    global const float *left = PLANE_OF(tiles[0], p) + 64, *here = PLANE_OF(tiles[1], p) + 64;
    return (float8)(left[4 * y + 3], vload4(y, here), (PLANE_OF(tiles[2], p))[64 + 4 * y], 0.0f, 0.0f);
}
INLINED float16 own_eight(global const float *inner, const int *tiles, int p, int y)
{
    global const float *left = PLANE_OF(tiles[0], p), *here = PLANE_OF(tiles[1], p);
    return (float16)(left[8 * y + 7], vload8(y, here), (PLANE_OF(tiles[2], p))[8 * y], (float4)0.0f, 0.0f, 0.0f);
}

/* The rows of a level that are around those of the level below which are needed. */
uint rows_around(uint needed, int count)
{
    uint around = 0;
    for (int y = 0; y < count; y++)
        around |= (needed >> y & 1u) * 3u << y / 2;
    return around;
}

/* A level of `side` cells, filled, with one more beyond each side, as far as its rows are needed */
#define PULL_LEVEL(type, side, filled, own, above_type, above, left, right, ...)                               \
    for (int y = 0; y < side + 2; y++) {                                                                       \
        if (!(needed_##filled >> y & 1u))                                                                      \
            continue;                                                                                          \
        const int *three = tile + (y == 0 ? 0 : y <= side ? 3 : 6), at = (y - 1) & (side - 1);                 \
        const int is_known = three[0] < tiles || three[1] < tiles || three[2] < tiles;                         \
        const type open = is_known ? 1.0f - own(inner, three, WEIGHT_PLANE, at) : (type)1.0f;                  \
        for (int p = 0; p < WEIGHT_PLANE; p++) {                                                               \
            const above_type row_ = ROW_BETWEEN(above[p], y);                                                  \
            filled[p][y] = open * CELLS_BETWEEN(type, row_, left, right, __VA_ARGS__);                         \
            if (is_known)                                                                                      \
                filled[p][y] += own(inner, three, p, at);                                                      \
        }                                                                                                      \
    }

/* A tile's first level, as far as needed for rows of its base, as bits, the first of them beyond the tile */
INLINED void pull_tile(uint needed, int column, int row, int across, int down, global const float *inner, global const float *cells,
                       float16 filled[WEIGHT_PLANE][10])
{
    const int tiles = across * down;
    int tile[9], where[9];
    for (int i = 0; i < 9; i++) {
        const int u = column + i % 3 - 1, v = row + i / 3 - 1;
        where[i] = clamp(v, 0, down - 1) * across + clamp(u, 0, across - 1);
        const int is_there = u >= 0 && v >= 0 && u < across && v < down && cells[WEIGHT_PLANE * tiles + where[i]] > 0.0f;
        tile[i] = is_there ? where[i] : tiles;
    }
    const float top = tiles == 1 ? 1.0f / cells[WEIGHT_PLANE] : 1.0f; /* a single cell is not filled from above */
    float4 one[WEIGHT_PLANE][3], two[WEIGHT_PLANE][4];
    for (int p = 0; p < WEIGHT_PLANE; p++)
        for (int v = 0; v < 3; v++)
            one[p][v] = top * (float4)(cells[p * tiles + where[3 * v]], cells[p * tiles + where[3 * v + 1]],
                                       cells[p * tiles + where[3 * v + 2]], 0.0f);
    float8 four[WEIGHT_PLANE][6];
    const uint needed_filled = rows_around(needed, TILE + 2), needed_four = rows_around(needed_filled, 10);
    const uint needed_two = rows_around(needed_four, 6);
    PULL_LEVEL(float4, 2, two, own_two, float4, one, xxyy, yyzz, PARTS_4)
    PULL_LEVEL(float8, 4, four, own_four, float4, two, s00112233, s11223333, PARTS_8)
    PULL_LEVEL(float16, 8, filled, own_eight, float8, four, s0011223344556677, s1122334455667777, PARTS_16)
}

/* Row y of the base, filled */
INLINED float16 pulled(float16 *filled, int y)
{
    const float16 row = ROW_BETWEEN(filled, y + 1);
    return CELLS_BETWEEN(float16, row, s0112233445566778, s1223344556677889, 0.75f, PARTS_8, PARTS_4, 0.25f, 0.75f, 0.25f);
}

kernel void pull_cells(global float *base, int width, int height, global const float *inner, global const float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int column = get_global_id(0), row = get_global_id(1);
    if (column >= across || row >= down)
        return;
    float16 filled[WEIGHT_PLANE][10];
    pull_tile(0x1fffe, column, row, across, down, inner, cells, filled);
    for (int y = 0; y < min(TILE, height - row * TILE); y++)
        for (int p = 0; p < WEIGHT_PLANE; p++) {
            const float16 values = pulled(filled[p], y);
            for (int x = 0; x < min(TILE, width - column * TILE); x++) {
                const int cell = (row * TILE + y) * width + column * TILE + x;
                base[p * height * width + cell] += (1.0f - base[WEIGHT_PLANE * height * width + cell]) * float_lane(values, x);
            }
        }
}

kernel void pull_pixels(global channel *color, global float *depth, global const uchar *valid, int width, int height,
                        int perspective, int strip, global const float *inner, global const float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int first = get_global_id(0) * strip, row = get_global_id(1);
    if (first >= across || row >= down)
        return;
    for (int column = first; column < min(first + strip, across); column++) {
        uint bits[TILE], needed = 0;
        for (int y = 0; y < TILE; y++) {
            bits[y] = hole_bits(valid, width, height, column * TILE, row * TILE + y, TILE / 8);
            needed |= bits[y] ? 2u << y : 0u;
        }
        if (!needed)
            continue;
        float16 filled[WEIGHT_PLANE][10];
        pull_tile(needed, column, row, across, down, inner, cells, filled);
        for (int y = 0; y < TILE; y++) {
            if (!bits[y])
                continue;
            const float16 nearness = pulled(filled[3], y), z = DEPTH_OF(perspective, nearness);
#if CHANNELS == 3
            const channel16 r = to_channel16(pulled(filled[0], y)), g = to_channel16(pulled(filled[1], y)), b = to_channel16(pulled(filled[2], y));
#endif
            for (uint left = bits[y]; left; left &= left - 1) {
                const int x = LOWEST(left);
                const size_t hole = (size_t)(row * TILE + y) * width + column * TILE + x;
                if (isnan(float_lane(nearness, x))) /* nothing is known in the whole picture */
                    return;
#if CHANNELS == 3
                color[3 * hole] = ((const channel *)&r)[x];
                color[3 * hole + 1] = ((const channel *)&g)[x];
                color[3 * hole + 2] = ((const channel *)&b)[x];
#endif
                depth[hole] = float_lane(z, x);
            }
        }
    }
}
