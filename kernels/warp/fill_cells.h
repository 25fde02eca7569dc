#ifndef WARP_FILL_CELLS_H
#define WARP_FILL_CELLS_H
/* Push and pull (fill.cl) for GPUs: a work-item computes one cell of a tile's first level (push), or one pixel or cell
 * of the base (pull), and for this recomputes coarser cells that other work-items compute, too. Terms are added in the
 * same order as in fill_tiles.h, so the sums are equal to the bit. */
#include "warp/pixel_weights.h"

#if LANES == 1
/* Reduces 2 x 2 pixels or cells to one cell, and writes it to `made`. four: for each plane, their values row by row.
 * plane: floats from one plane of `made` to the next */
#define ROW_OF_FOUR(p, i) (i == 0 ? four[p].xy : four[p].zw)
#define MADE_CELL(p) made[(size_t)(p) * plane]
INLINED void put_cell(const float4 *four, int level, int perspective, global float *made, int plane)
{
    HALVE(float2, float, MADE_CELL, ROW_OF_FOUR, level)
}

#if HAS_BEHIND
/* The holes next to a valid pixel, as bits, in row v of a tile and its halo. behind.cl may have left out other
 * holes. */
INLINED uint edge_bits(global const uchar *valid, int width, int height, int tile_x, int tile_y, int v)
{
    uint known = 0;
    for (int w = max(v - 1, 0); w <= min(v + 1, HALO_TILE - 1); w++) {
        const uint holes = hole_bits(valid, width, height, tile_x - HALO, tile_y - HALO + w, HALO_TILE / 8);
        const uint there = ~holes & 0xffffffu;
        known |= there | there << 1 | there >> 1;
    }
    return known & (uint)hole_bits(valid, width, height, tile_x - HALO, tile_y - HALO + v, HALO_TILE / 8);
}

/* The weights of 2 x 2 pixels with depths z, row by row; the first is (x, y). All four depend on the farthest depth
 * behind the holes in the 12 x 12 pixels around their block of 4 x 4. The weight of each pixel also depends on the
 * holes within BESIDE pixels of it: on the greatest of their falloffs (behind.cl), and on the farthest depth behind
 * those holes whose falloff is not 0. */
INLINED float4 pixel_weights(global const uchar *valid, global const float *behind, int width, int height, int pitch,
                             int x, int y, float4 z)
{
    const int tile_x = x / TILE * TILE, tile_y = y / TILE * TILE, left = (x - tile_x) & ~3, top = (y - tile_y) & ~3;
    float around = 0.0f;
    float4 touching = 0.0f, falloffs = 0.0f;
    for (int v = top; v < top + 4 + 2 * HALO; v++) {
        global const float *row = behind + (size_t)(tile_y + v) * pitch + tile_x;
        uint edges = edge_bits(valid, width, height, tile_x, tile_y, v) & 0xfffu << left;
        for (; edges; edges &= edges - 1) {
            const int u = LOWEST(edges), dx = tile_x + u - HALO - x, dy = tile_y + v - HALO - y;
            around = fmax(around, row[u]);
            if (dx < -BESIDE || dx > 1 + BESIDE || dy < -BESIDE || dy > 1 + BESIDE)
                continue;
            const float steep = row[BEHIND_PLANE(height, pitch) + u], far = steep != 0.0f ? row[u] : 0.0f;
            const int4 is_beside = (abs(dx - (int4)(0, 1, 0, 1)) <= BESIDE) & (abs(dy - (int4)(0, 0, 1, 1)) <= BESIDE);
            falloffs = (is_beside & (falloffs < steep)) ? steep : falloffs;
            touching = (is_beside & (touching < far)) ? far : touching;
        }
    }
    return (float4)(weights_of(z.x, around, touching.x, falloffs.x), weights_of(z.y, around, touching.y, falloffs.y),
                    weights_of(z.z, around, touching.z, falloffs.z), weights_of(z.w, around, touching.w, falloffs.w));
}
#endif

#define EACH_OF_FOUR(F) F(0, s0) F(1, s1) F(2, s2) F(3, s3)

/* Computes a cell of the first level of a tile of pixels. */
INLINED void push_quad(global const channel *color, global const float *depth, global const uchar *valid,
                       global const float *behind, int width, int height, int pitch, int perspective, int column, int row,
                       int across, int down, global float *inner, global float *cells)
{
    const int x = 2 * column, y = 2 * row;
    uint bits[4];
    UNROLLED
    for (int i = 0; i < 4; i++)
        bits[i] = hole_bits(valid, width, height, x - BESIDE, y - BESIDE + i, 1);
    const uint upper = bits[0] | bits[1] | bits[2], lower = bits[1] | bits[2] | bits[3];
    const uint4 near = (uint4)(upper & 7, upper >> 1 & 7, lower & 7, lower >> 1 & 7);
    float4 planes[PLANES] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f}, z = 1.0f, weights = 1.0f;
    int4 pixels;
#define FIND_PIXEL(i, s)                                                                                             \
    pixels.s = (y + i / 2) * width + x + i % 2;                                                                \
    if (near.s && x + i % 2 < width && y + i / 2 < height && valid[pixels.s])                                 \
        z.s = depth[pixels.s];                                                                                 \
    else                                                                                                       \
        pixels.s = -1;
    EACH_OF_FOUR(FIND_PIXEL)
#if HAS_BEHIND
    if (any(pixels >= 0))
        weights = pixel_weights(valid, behind, width, height, pitch, x, y, z);
#endif
    weights = pixels >= 0 ? weights : 0.0f;
#if CHANNELS == 3
#define WEIGH_COLOR(i, s)                                                                                            \
    for (int p = 0; p < 3; p++)                                                                                \
        planes[p].s = pixels.s >= 0 ? weights.s * color[3 * (size_t)pixels.s + p] : 0.0f;
    EACH_OF_FOUR(WEIGH_COLOR)
#endif
    planes[3] = weights * DEPTH_OF(perspective, z);
    planes[WEIGHT_PLANE] = weights;
    put_cell(planes, 0, perspective, inner + FIRST_CELL(column, row, across), INNER_CELLS);
}

/* Computes a cell of the first level of a tile of cells. */
INLINED void push_base_quad(global const float *base, int width, int height, int perspective, int level, int column, int row,
                       int across, int down, global float *inner, global float *cells)
{
    const int x = 2 * column, y = 2 * row;
    float4 four[PLANES];
    UNROLLED
    for (int p = 0; p < PLANES; p++) {
        global const float *upper = base + (p * height + y) * width + x, *lower = upper + width;
        four[p] = (float4)(x < width && y < height ? upper[0] : 0.0f, x + 1 < width && y < height ? upper[1] : 0.0f,
                           x < width && y + 1 < height ? lower[0] : 0.0f,
                           x + 1 < width && y + 1 < height ? lower[1] : 0.0f);
    }
    put_cell(four, level, perspective, inner + FIRST_CELL(column, row, across), INNER_CELLS);
}

/* Computes a tile's other levels. level: the level of its pixels or cells */
kernel void push_levels(int width, int height, int perspective, int level, global float *inner, global float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int column = get_global_id(0), row = get_global_id(1), tile = row * across + column;
    if (column >= across || row >= down)
        return;
    global float *from = inner + (size_t)tile * PLANES * INNER_CELLS;
    for (int side = TILE / 4; side > 0; side /= 2) {
        level++;
        global float *to = from + 4 * side * side;
        for (int i = 0; i < side * side; i++) {
            float4 four[PLANES];
            UNROLLED
            for (int p = 0; p < PLANES; p++) {
                global const float *corner = from + p * INNER_CELLS + i / side * 4 * side + i % side * 2;
                four[p] = (float4)(vload2(0, corner), vload2(side, corner));
            }
            put_cell(four, level, perspective, side > 1 ? to + i : cells + tile, side > 1 ? INNER_CELLS : across * down);
        }
        from = to;
    }
}

/* For cell (x, y) of a level with `side` x `side` cells a tile: 1 minus its weight, and the value that push stored in
 * plane p; (1, 0) outside of the picture */
INLINED float2 open_and_own(global const float *level, int across, int down, int side, int p, int x, int y)
{
    const int column = x >= 0 ? x / side : -1, row = y >= 0 ? y / side : -1;
    if (column < 0 || row < 0 || column >= across || row >= down)
        return (float2)(1.0f, 0.0f);
    global const float *cell = level + (size_t)(row * across + column) * PLANES * INNER_CELLS + y % side * side + x % side;
    return (float2)(1.0f - cell[WEIGHT_PLANE * INNER_CELLS], cell[p * INNER_CELLS]);
}

/* 3 x 3 cells are interpolated from 3 x 3 cells of the next coarser level. BEGIN_ABOVE: the first column (or row) of
 * the 3 x 3 cells, n levels coarser, that pixel x depends on. */
#define BEGIN_ABOVE(x, n) ((((x) + 1) >> (n)) - 1)
#define PART(x) ((x) & 1 ? 0.25f : 0.75f)
#define LATER(i, x) ((i) == 1 ? !((x) & 1) : (i) / 2) /* does cell i lie between the last two coarser cells? */

/* Fills 3 x 3 cells of a level, from (x, y) on, from 3 x 3 cells of the next coarser level. cells: at first the
 * coarser cells' values, then the filled cells' */
INLINED void pull_around(global const float *level, int across, int down, int side, int p, int x, int y, float *cells)
{
    float filled[9];
    UNROLLED
    for (int j = 0; j < 3; j++) {
        float between[3];
        UNROLLED
        for (int i = 0; i < 3; i++)
            between[i] = LATER(j, y) ? mix(cells[3 + i], cells[6 + i], PART(y + j)) : mix(cells[i], cells[3 + i], PART(y + j));
        UNROLLED
        for (int i = 0; i < 3; i++) {
            const float2 told = open_and_own(level, across, down, side, p, x + i, y + j);
            const float left = LATER(i, x) ? between[1] : between[0], right = LATER(i, x) ? between[2] : between[1];
            filled[3 * j + i] = told.x * mix(left, right, PART(x + i));
            filled[3 * j + i] += told.y;
        }
    }
    UNROLLED
    for (int i = 0; i < 9; i++)
        cells[i] = filled[i];
}

/* The value of pixel or cell (x, y) of the base in plane p, interpolated from the filled first level */
INLINED float pulled_plane(global const float *inner, global const float *cells, int across, int down, int p, int x, int y)
{
    const int tiles = across * down;
    const float top = tiles == 1 ? 1.0f / cells[WEIGHT_PLANE] : 1.0f; /* a single cell gets weight 1 */
    float filled[9];
    UNROLLED
    for (int i = 0; i < 9; i++)
        filled[i] = top * cells[p * tiles + clamp(BEGIN_ABOVE(y, 4) + i / 3, 0, down - 1) * across +
                                clamp(BEGIN_ABOVE(x, 4) + i % 3, 0, across - 1)];
    ROLLED
    for (int n = 3, side = 2, first = INNER_CELLS; n > 0; n--, side *= 2) {
        first -= side * side;
        pull_around(inner + first, across, down, side, p, BEGIN_ABOVE(x, n), BEGIN_ABOVE(y, n), filled);
    }
    return mix(mix(filled[0], filled[3], PART(y)), mix(filled[1], filled[4], PART(y)), PART(x));
}

INLINED void pull_cell(global float *base, int width, int height, int x, int y, int across, int down,
                       global const float *inner, global const float *cells)
{
    const int plane = width * height, cell = y * width + x;
    const float open = 1.0f - base[WEIGHT_PLANE * plane + cell];
    for (int p = 0; p < WEIGHT_PLANE; p++)
        base[p * plane + cell] += open * pulled_plane(inner, cells, across, down, p, x, y);
}

INLINED void pull_pixel(global channel *color, global float *depth, global const uchar *valid,
                        global const float *behind, int width, int height, int pitch, int perspective, int x, int y,
                        int across, int down, global const float *inner, global const float *cells)
{
    const size_t pixel = (size_t)y * width + x;
    if (valid[pixel])
        return;
    float4 own = 0.0f;
    for (int p = CHANNELS == 3 ? 0 : 3; p < WEIGHT_PLANE; p++)
        own = (float4)(own.yzw, pulled_plane(inner, cells, across, down, p, x, y));
    if (isnan(own.w)) /* the whole picture has no valid pixel */
        return;
    depth[pixel] = DEPTH_OF(perspective, own.w);
#if CHANNELS == 3
    vstore3(to_channels(own).xyz, pixel, color);
#endif
#if HAS_BEHIND && CHANNELS == 3
    if ((x > 0 && valid[pixel - 1]) || (x + 1 < width && valid[pixel + 1]) || (y > 0 && valid[pixel - width]) ||
        (y + 1 < height && valid[pixel + width]))
        show_rim(color, depth, valid, behind, width, height, pitch, x, y, own);
#endif
}
#endif
#endif
