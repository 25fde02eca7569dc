/* Holes filled from around them by push and pull (Gortler, Grzeszczuk, Szeliski, Cohen: The Lumigraph, 1996, section
 * 3.4): valid pixels beside holes are averaged into ever coarser cells of a pyramid (push, pyramid.h), and each hole
 * takes from coarse levels what finer ones do not know (pull). So narrow holes are filled from close by and wide ones
 * from all around.
 *
 * With HAS_BEHIND a disocclusion is filled from what lies behind, not from what hid it: a pixel nearer than what lies
 * behind the holes beside it (behind.cl) weighs next to nothing, and of others the less the nearer they are than what
 * lies behind those some pixels away. But no weight is 0: where there is no background far and wide, the foreground
 * fills the hole. Holes beside the foreground show half of it: silhouettes in photographs are mixed with what is behind
 * them over a pixel, and round things go on.
 *
 * color, depth, valid: (height, width). behind: behind.cl. base, cells, inner: pyramid.h; the base of the lowest tiles
 * are the pixels. pull replaces the cells' colour and nearness by the filled ones. Work-item: a row of `strip` tiles
 * (pixels), or a tile (cells). Cost: O(pixels). Determinism: no pixel that is written is read, but by its own
 * work-item; sums run in a fixed order.
 */
#include "lib/pixelspace.h"
#include "warp/pyramid.h"
#include "warp/pixel_rows.h"

#define HALO_TILE 24          /* TILE + 2 * HALO */
#define BESIDE 1              /* pixels from a hole within which valid ones have a weight */
#define PIXEL_WEIGHT_MIN 1e-6f /* of any pixel: more than nothing */
#define RIM 0.5f              /* the part of the foreground in holes beside it */

#if HAS_BEHIND
/* The greatest depth at which what lies behind begins, of the holes in the 12 x 12 pixels around each 4 x 4 pixels of a
 * tile, as four rows; and `beside` each row's pixels, of the holes that touch them. Only holes beside valid pixels of
 * the tile and its halo count: of others behind.cl may know nothing. */
INLINED void read_behind(global const float *behind, int pitch, const uint *bits, const uint *inside, float16 *around,
                         float16 *beside)
{
    uint known[HALO_TILE];
    for (int v = 0; v < HALO_TILE; v++) {
        const uint valid = ~bits[v] & inside[v];
        known[v] = valid | valid << 1 | valid >> 1;
    }
    for (int y = 0; y < TILE; y++)
        beside[y] = 0.0f;
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
            float16 three = 0.0f;
            for (int i = HALO - BESIDE; i <= HALO + BESIDE; i++)
                three = fmax(three, MASKED(AMONG(edge >> i), vload16(0, row + i)));
            for (int y = max(v - HALO - BESIDE, 0); y <= min(v - HALO + BESIDE, TILE - 1); y++)
                beside[y] = fmax(beside[y], three);
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
INLINED float16 weights_of(float16 z, float16 around, float16 beside)
{
    float16 ratio = around > z ? z / around : (float16)1.0f;
    ratio *= ratio;
    ratio *= ratio;
    ratio *= ratio * ratio; /* to the 12th power */
    return z < beside || ratio < PIXEL_WEIGHT_MIN ? (float16)PIXEL_WEIGHT_MIN : ratio;
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
    uint inside[HALO_TILE]; /* the picture */
    const int first = max(HALO - tile_x, 0), end = min(width - tile_x + HALO, HALO_TILE);
    for (int v = 0; v < HALO_TILE; v++)
        inside[v] = tile_y + v >= HALO && tile_y + v - HALO < height ? (1u << end) - (1u << first) : 0u;
    float16 around[4], limits[TILE];
    read_behind(behind + (size_t)tile_y * pitch + tile_x, pitch, bits, inside, around, limits);
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
            weights = weights_of(z, around[v / 4], limits[v]);
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
INLINED void pull_tile(uint needed, int column, int row, int across, int down, global const float *inner,
                       global const float *cells, float16 filled[WEIGHT_PLANE][10])
{
    const int tiles = across * down;
    int tile[9], where[9];
    for (int i = 0; i < 9; i++) {
        const int u = column + i % 3 - 1, v = row + i / 3 - 1;
        where[i] = clamp(v, 0, down - 1) * across + clamp(u, 0, across - 1);
        const int is_inside = u >= 0 && v >= 0 && u < across && v < down;
        const int is_there = is_inside && cells[WEIGHT_PLANE * tiles + where[i]] > 0.0f;
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
    return CELLS_BETWEEN(float16, row, s0112233445566778, s1223344556677889, 0.75f, PARTS_8, PARTS_4, 0.25f, 0.75f,
                         0.25f);
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
                const float open = 1.0f - base[WEIGHT_PLANE * height * width + cell];
                base[p * height * width + cell] += open * float_lane(values, x);
            }
        }
}

#if HAS_BEHIND && CHANNELS == 3
/* Holes of row y of a tile, whose rows' holes are `bits`, beside which something is seen in their row or column */
uint beside_seen(global const uchar *valid, int width, int height, int x0, int v, const uint *bits, int y)
{
    global const uchar *row = valid + (size_t)v * width + x0;
    const uint left = x0 > 0 && row[-1] ? 0u : 1u, right = x0 + TILE < width && row[TILE] ? 0u : 1u << (TILE - 1);
    uint above = ~0u, below = ~0u;
    if (v > 0)
        above = y > 0 ? bits[y - 1] : (uint)hole_bits(valid, width, height, x0, v - 1, TILE / 8);
    if (v < height - 1)
        below = y < TILE - 1 ? bits[y + 1] : (uint)hole_bits(valid, width, height, x0, v + 1, TILE / 8);
    return bits[y] & ~(above & below & (bits[y] << 1 | left) & (bits[y] >> 1 | right));
}

/* Half of the foreground beside a hole, where there is any, in the hole's colour. */
void mix_rim(global channel *color, global const float *depth, global const uchar *valid, int width, int height, int x,
             int y, float limit)
{
    if (limit == 0.0f)
        return;
    const size_t hole = (size_t)y * width + x;
    float4 sum = 0.0f;
    for (int side = 0; side < 4; side++) {
        const int u = x + (side == 0) - (side == 1), v = y + (side == 2) - (side == 3);
        const size_t at = (size_t)v * width + u;
        if (u < 0 || v < 0 || u >= width || v >= height || !valid[at] || depth[at] >= limit)
            continue;
        sum += (float4)(color[3 * at], color[3 * at + 1], color[3 * at + 2], 1.0f);
    }
    if (sum.w == 0.0f)
        return;
    const float4 own = (float4)(color[3 * hole], color[3 * hole + 1], color[3 * hole + 2], 0.0f);
    vstore3(to_channels(mix(own, sum / sum.w, RIM)).xyz, hole, color);
}
#endif

kernel void pull_pixels(global channel *color, global float *depth, global const uchar *valid,
                        global const float *behind, int width, int height, int pitch, int perspective, int strip,
                        global const float *inner, global const float *cells)
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
            const channel16 r = to_channel16(pulled(filled[0], y)), g = to_channel16(pulled(filled[1], y));
            const channel16 b = to_channel16(pulled(filled[2], y));
#endif
            const size_t pixel = (size_t)(row * TILE + y) * width + column * TILE;
            if (isnan(float_lane(nearness, 0))) /* nothing is known in the whole picture */
                return;
            if (bits[y] == 0xffffu) {
#if CHANNELS == 3
                write_row(color + 3 * pixel, r, g, b);
#endif
                vstore16(z, 0, depth + pixel);
            }
            for (uint left = bits[y] == 0xffffu ? 0u : bits[y]; left; left &= left - 1) {
                const int x = LOWEST(left);
                const size_t hole = pixel + x;
#if CHANNELS == 3
                color[3 * hole] = ((const channel *)&r)[x];
                color[3 * hole + 1] = ((const channel *)&g)[x];
                color[3 * hole + 2] = ((const channel *)&b)[x];
#endif
                depth[hole] = float_lane(z, x);
            }
#if HAS_BEHIND && CHANNELS == 3
            const int v = row * TILE + y;
            for (uint left = beside_seen(valid, width, height, column * TILE, v, bits, y); left; left &= left - 1) {
                const int u = column * TILE + LOWEST(left);
                mix_rim(color, depth, valid, width, height, u, v, behind[(size_t)(v + HALO) * pitch + u + HALO]);
            }
#endif
        }
    }
}
