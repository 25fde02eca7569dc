#ifndef WARP_FILL_TILES_H
#define WARP_FILL_TILES_H
/* Push and pull (fill.cl) for CPUs: a work-item computes whole tiles; a vector holds a row of a tile. */
#include "warp/pixel_rows.h"
#include "warp/pixel_weights.h"

#if LANES == 16
#define ELEMENT(values, x) (((const float *)&(values))[x]) /* element x of 16 values */

/* The values of a tile's four levels in each plane; the elements of a vector are the cells of a row. */
typedef struct {
    float8 eight[PLANES][8];
    float4 four[PLANES][4];
    float2 two[PLANES][2];
    float one[PLANES];
} Levels;

#define ROW_16(p, i) rows[i].plane[p]
#define ROW_8(p, i) levels->eight[p][2 * y + (i)]
#define ROW_4(p, i) levels->four[p][2 * y + (i)]
#define ROW_2(p, i) levels->two[p][i]
#define EIGHT(p) levels->eight[p][y]
#define FOUR(p) levels->four[p][y]
#define TWO(p) levels->two[p][y]
#define ONE(p) levels->one[p]

/* Computes a tile's coarser levels from its first one, and writes all of its levels. */
INLINED void write_levels(Levels *levels, int level, int perspective, int tile, int tiles, global float *inner,
                          global float *cells)
{
    for (int y = 0; y < 4; y++)
        HALVE(float8, float4, FOUR, ROW_8, level)
    for (int y = 0; y < 2; y++)
        HALVE(float4, float2, TWO, ROW_4, level + 1)
    HALVE(float2, float, ONE, ROW_2, level + 2)
    for (int p = 0; p < PLANES; p++) {
        global float *to = inner + ((size_t)tile * PLANES + p) * INNER_CELLS;
        for (int y = 0; y < 8; y++)
            vstore8(levels->eight[p][y], y, to);
        for (int y = 0; y < 4; y++)
            vstore4(levels->four[p][y], y, to + 64);
        for (int y = 0; y < 2; y++)
            vstore2(levels->two[p][y], y, to + 80);
        cells[p * tiles + tile] = levels->one[p];
    }
}

void clear_tile(int tile, int tiles, global float *cells)
{
    for (int p = 0; p < PLANES; p++)
        cells[p * tiles + tile] = 0.0f;
}

/* Sets the extra tile after the last one to 0. pull reads it instead of tiles outside of the picture and tiles of
 * weight 0. */
void clear_last(int tiles, global float *inner)
{
    for (int i = 0; i < PLANES * INNER_CELLS; i++)
        inner[(size_t)tiles * PLANES * INNER_CELLS + i] = 0.0f;
}
#if HAS_BEHIND
/* Are all values zero? (any() compiles to a branch for each lane.) */
INLINED int is_zero(float16 values)
{
    const uint8 half_ = as_uint16(values).lo | as_uint16(values).hi;
    const uint4 quarter = half_.lo | half_.hi;
    return (quarter.x | quarter.y | quarter.z | quarter.w) == 0;
}

/* Reads `behind` for the pixels of a tile. around[i]: in rows 4 i to 4 i + 3, the farthest depth behind the holes in
 * the 12 x 12 pixels around each pixel's block of 4 x 4. falloffs, touching: for each pixel, the greatest falloff
 * (behind.cl) of the holes that touch it, and the farthest depth behind those whose falloff is not 0. Holes count only
 * if they are next to a valid pixel of the tile or its halo: behind.cl may have left out others. */
INLINED void read_behind(global const float *behind, size_t plane, int pitch, const uint *bits, float16 *around,
                         float16 *touching, float16 *falloffs)
{
    uint known[HALO_TILE];
    for (int v = 0; v < HALO_TILE; v++) {
        const uint valid = ~bits[v] & 0xffffffu;
        known[v] = valid | valid << 1 | valid >> 1;
    }
    for (int y = 0; y < TILE; y++)
        touching[y] = falloffs[y] = 0.0f;
    float4 bands[HALO_TILE / 4];
    for (int band = 0; band < HALO_TILE / 4; band++) {
        float16 left = 0.0f, right = 0.0f; /* columns 0 to 15, and 8 to 23 */
        for (int v = 4 * band; v < 4 * band + 4; v++) {
            const uint edge = bits[v] & (known[max(v - 1, 0)] | known[v] | known[min(v + 1, HALO_TILE - 1)]);
            if (!edge)
                continue;
            global const float *row = behind + v * pitch;
            const float16 one = MASKED(AMONG(edge), vload16(0, row));
            const float16 other = MASKED(AMONG(edge >> 8), vload16(0, row + 8));
            left = left > one ? left : one;
            right = right > other ? right : other;
            if (v < HALO - BESIDE || v >= HALO + TILE + BESIDE)
                continue;
            float16 far = 0.0f, steep = 0.0f, told[2 * BESIDE + 1];
            for (int i = 0; i <= 2 * BESIDE; i++) {
                told[i] = MASKED(AMONG(edge >> (HALO - BESIDE + i)), vload16(0, row + plane + HALO - BESIDE + i));
                steep = steep > told[i] ? steep : told[i];
            }
            if (is_zero(steep))
                continue;
            for (int i = 0; i <= 2 * BESIDE; i++) {
                const float16 each = MASKED(told[i] != 0.0f, vload16(0, row + HALO - BESIDE + i));
                far = far > each ? far : each;
            }
            for (int y = max(v - HALO - BESIDE, 0); y <= min(v - HALO + BESIDE, TILE - 1); y++) {
                falloffs[y] = falloffs[y] > steep ? falloffs[y] : steep;
                touching[y] = touching[y] > far ? touching[y] : far;
            }
        }
        const float8 left_pairs = fmax(left.even, left.odd), right_pairs = fmax(right.even, right.odd);
        const float4 low = fmax(left_pairs.even, left_pairs.odd), high = fmax(right_pairs.even, right_pairs.odd);
        bands[band] = fmax(fmax(low, high), (float4)(low.yzw, high.z));
    }
    for (int i = 0; i < 4; i++)
        around[i] = fmax(fmax(bands[i], bands[i + 1]), bands[i + 2]).xxxxyyyyzzzzwwww;
}
#endif

void push_tile(global const channel *color, global const float *depth, global const uchar *valid,
               global const float *behind, int width, int height, int pitch, int perspective, int column, int row,
               int across, int down, global float *inner, global float *cells)
{
    const int tile = row * across + column, tiles = across * down;
    const int tile_x = column * TILE, tile_y = row * TILE, count = min(TILE, width - tile_x);
    if (tile == 0)
        clear_last(tiles, inner);
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
    float16 around[4], touching[TILE], falloffs[TILE];
    read_behind(behind + (size_t)tile_y * pitch + tile_x, BEHIND_PLANE(height, pitch), pitch, bits, around, touching,
                falloffs);
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
            weights = weights_of(z, around[v / 4], touching[v], falloffs[v]);
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

INLINED void push_base_tile(global const float *base, int width, int height, int perspective, int level, int column, int row,
                       int across, int down, global float *inner, global float *cells)
{
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

/* Interpolates row y of a level between the two nearest rows of the next coarser level; row 0 is above the tile. */
#define ROW_BETWEEN(above, y) mix((above)[(y) / 2], (above)[(y) / 2 + 1], (y) & 1 ? 0.75f : 0.25f)
/* Interpolates the cells of this row between the coarser cells: `left` and `right` select the two coarser cells beside
 * each. */
#define CELLS_BETWEEN(type, row, left, right, ...) mix((row).left, (row).right, (type)(__VA_ARGS__))

/* The values that push stored for row y of a level, in plane p, and for one more cell on either side of the tile.
 * tiles: the left neighbour, the tile and the right neighbour */
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

/* The rows of a level from which the `needed` rows of the next finer level are interpolated, as bits. count: the number
 * of rows of the finer level */
uint rows_around(uint needed, int count)
{
    uint around = 0;
    for (int y = 0; y < count; y++)
        around |= (needed >> y & 1u) * 3u << y / 2;
    return around;
}

/* Fills the needed rows of a level of `side` x `side` cells a tile, and one more row or column on each of the four
 * sides. */
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

/* Fills a tile's first level. needed: a bit for each row of pixels (or cells) to fill; bit 0 is the row above the
 * tile. */
INLINED void pull_first(uint needed, int column, int row, int across, int down, global const float *inner,
                        global const float *cells, float16 filled[WEIGHT_PLANE][10])
{
    const int tiles = across * down;
    int tile[9], where[9];
    for (int i = 0; i < 9; i++) {
        const int u = column + i % 3 - 1, v = row + i / 3 - 1;
        where[i] = clamp(v, 0, down - 1) * across + clamp(u, 0, across - 1);
        const int is_there = u >= 0 && v >= 0 && u < across && v < down && cells[WEIGHT_PLANE * tiles + where[i]] > 0.0f;
        tile[i] = is_there ? where[i] : tiles;
    }
    const float top = tiles == 1 ? 1.0f / cells[WEIGHT_PLANE] : 1.0f; /* a single cell gets weight 1 */
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

/* Row y of the tile's pixels (or cells), interpolated from the filled first level */
INLINED float16 pulled(float16 *filled, int y)
{
    const float16 row = ROW_BETWEEN(filled, y + 1);
    return CELLS_BETWEEN(float16, row, s0112233445566778, s1223344556677889, 0.75f, PARTS_8, PARTS_4, 0.25f, 0.75f, 0.25f);
}

INLINED void pull_base_tile(global float *base, int width, int height, int column, int row, int across, int down,
                       global const float *inner, global const float *cells)
{
    float16 filled[WEIGHT_PLANE][10];
    pull_first(0x1fffe, column, row, across, down, inner, cells, filled);
    for (int y = 0; y < min(TILE, height - row * TILE); y++)
        for (int p = 0; p < WEIGHT_PLANE; p++) {
            const float16 values = pulled(filled[p], y);
            for (int x = 0; x < min(TILE, width - column * TILE); x++) {
                const int cell = (row * TILE + y) * width + column * TILE + x;
                base[p * height * width + cell] += (1.0f - base[WEIGHT_PLANE * height * width + cell]) * ELEMENT(values, x);
            }
        }
}

INLINED void pull_tile(global channel *color, global float *depth, global const uchar *valid, global const float *behind,
                       int width, int height, int pitch, int perspective, int column, int row, int across, int down,
                       global const float *inner, global const float *cells)
{
    uint bits[TILE + 2], needed = 0; /* holes of the tile and of one more pixel on every side; bit 0 is the leftmost */
    for (int y = 0; y < TILE + 2; y++)
        bits[y] = hole_bits(valid, width, height, column * TILE - 1, row * TILE + y - 1, 3);
    for (int y = 0; y < TILE; y++)
        needed |= bits[y + 1] >> 1 & 0xffffu ? 2u << y : 0u;
    if (!needed)
        return;
    float16 filled[WEIGHT_PLANE][10];
    pull_first(needed, column, row, across, down, inner, cells, filled);
    for (int y = 0; y < TILE; y++) {
        const uint *here = bits + y + 1, holes = here[0] >> 1 & 0xffffu;
        if (!holes)
            continue;
        const float16 nearness = pulled(filled[3], y), z = DEPTH_OF(perspective, nearness);
        const size_t pixel = (size_t)(row * TILE + y) * width + column * TILE;
#if CHANNELS == 3
        const float16 red = pulled(filled[0], y), green = pulled(filled[1], y), blue = pulled(filled[2], y);
        const channel16 r = to_channel16(red), g = to_channel16(green), b = to_channel16(blue);
#endif
        if (isnan(ELEMENT(nearness, 0))) /* the whole picture has no valid pixel */
            return;
        if (holes == 0xffffu) {
#if CHANNELS == 3
            write_row(color + 3 * pixel, r, g, b);
#endif
            vstore16(z, 0, depth + pixel);
        }
        for (uint left = holes == 0xffffu ? 0u : holes; left; left &= left - 1) {
            const int x = LOWEST(left);
#if CHANNELS == 3
            color[3 * (pixel + x)] = ((const channel *)&r)[x];
            color[3 * (pixel + x) + 1] = ((const channel *)&g)[x];
            color[3 * (pixel + x) + 2] = ((const channel *)&b)[x];
#endif
            depth[pixel + x] = ELEMENT(z, x);
        }
#if HAS_BEHIND && CHANNELS == 3
        const uint inner_holes = (here[-1] & here[1] & here[0] << 1 & here[0] >> 1) >> 1;
        for (uint left = holes & ~inner_holes; left; left &= left - 1) {
            const int x = LOWEST(left), u = column * TILE + x, v = row * TILE + y;
            const float4 own = (float4)(ELEMENT(red, x), ELEMENT(green, x), ELEMENT(blue, x), 0.0f);
            show_rim(color, depth, valid, behind, width, height, pitch, u, v, own);
        }
#endif
    }
}
#endif
#endif
