#ifndef WARP_PIXEL_ROWS_H
#define WARP_PIXEL_ROWS_H
/* Reads and writes colours and depths of rows of TILE pixels for push and pull (fill.cl). */
#include "lib/channel.h"
#include "warp/pyramid.h"

/* A row of 16 pixels or cells: a vector of 16 values for each plane */
typedef struct {
    float16 plane[PLANES];
} Row;

#if CHANNELS == 3 && COLOR_BYTES == 1
#define to_channel16 convert_uchar16_sat_rte
#define channel16 uchar16
typedef struct __attribute__((packed)) {
    uchar16 bytes;
} SixteenBytes;
#define LOAD16(p) ((global const SixteenBytes *)(p))->bytes
#define STORE16(v, p) ((global SixteenBytes *)(p))->bytes = (v)
#elif CHANNELS == 3
#define to_channel16(values) (values)
#define channel16 float16
#define LOAD16(p) vload16(0, p)
#define STORE16(v, p) vstore16(v, 0, p)
#endif

/* Reads the colours of `count` pixels of a row, at most 16; the rest of the planes becomes 0. */
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

#if CHANNELS == 3
INLINED void write_row(global channel *color, channel16 r, channel16 g, channel16 b)
{
    const channel16 first =
        (channel16)(r.s0, g.s0, b.s0, r.s1, g.s1, b.s1, r.s2, g.s2, b.s2, r.s3, g.s3, b.s3, r.s4, g.s4, b.s4, r.s5);
    const channel16 next =
        (channel16)(g.s5, b.s5, r.s6, g.s6, b.s6, r.s7, g.s7, b.s7, r.s8, g.s8, b.s8, r.s9, g.s9, b.s9, r.sa, g.sa);
    const channel16 last =
        (channel16)(b.sa, r.sb, g.sb, b.sb, r.sc, g.sc, b.sc, r.sd, g.sd, b.sd, r.se, g.se, b.se, r.sf, g.sf, b.sf);
    STORE16(first, color);
    STORE16(next, color + 16);
    STORE16(last, color + 32);
}
#endif

INLINED float16 row_depths(global const float *depth, size_t pixel, int count)
{
    if (count == TILE)
        return vload16(0, depth + pixel);
    float values[TILE];
    for (int i = 0; i < TILE; i++)
        values[i] = i < count ? depth[pixel + i] : 1.0f;
    return vload16(0, values);
}
#endif
