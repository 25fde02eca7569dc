#ifndef RASTER_REGION_H
#define RASTER_REGION_H
/* The region of pixels that a work-item draws: read from the picture, drawn, and written back.
 *
 * On a CPU a region is a bin, processed in blocks of 4 x 4 pixels, one pixel to a lane; on a GPU it is one pixel.
 */
#include "lib/color.h"
#include "lib/gbuffer.h"
#include "lib/screen.h"

#ifndef KEEPS_UV
#define KEEPS_UV 0 /* 1: a region also stores each pixel's position on its owner */
#endif

#if LANES == 16
#define REGION BIN /* width and height of a work-item's region in pixels */
#define BLOCK 4
#define block_x (lane_index & 3)
#define block_y (lane_index >> 2)
#define BLOCK_AT(column, row) ((row) * ROW + (column))
#else
#define REGION 1
#define BLOCK 1
#define block_x 0
#define block_y 0
#define BLOCK_AT(column, row) 0
#endif
#define ROW (REGION / BLOCK) /* blocks in a row */
#define BLOCKS (ROW * ROW)
#define FIRST_X(block) ((block) % ROW * BLOCK) /* a block's first pixel in the region */
#define FIRST_Y(block) ((block) / ROW * BLOCK)

typedef struct {
    Screen screen;
    global float *depth;   /* (height, width), NaN where empty */
    global channel *color; /* (height, width, 3) */
    global uchar *valid;   /* (height, width) */
    int blank;             /* 1: the picture is empty, and every pixel must be written */
} Picture;

/* Kernel parameters of a picture besides `screen`, and the initializer of its Picture */
#define PICTURE_PARAMETERS global float *depth, global channel *color, global uchar *valid, int blank
#define PICTURE_VALUE {screen, depth, color, valid, blank}

typedef struct {
    floatl nearness[BLOCKS]; /* each pixel's visible point has this nearness; EMPTY: no point */
    intl owner[BLOCKS];      /* visible primitive; -1: none that this kernel drew */
    float farthest[BLOCKS];  /* least nearness in the block */
#if KEEPS_UV
    floatl u[BLOCKS], v[BLOCKS]; /* position on the owner */
#endif
    int x, y; /* first pixel */
} Region;

/* Columns and rows of a block's pixels in the picture */
#define BLOCK_X(region, block) to_floatl((region)->x + FIRST_X(block) + block_x)
#define BLOCK_Y(region, block) to_floatl((region)->y + FIRST_Y(block) + block_y)

/* Index of a lane's pixel in the block at (x, y); -1 outside the picture */
long pixel_of(Screen screen, int x, int y, int lane)
{
    const int px = x + lane % BLOCK, py = y + lane / BLOCK;
    return px < screen.width && py < screen.height ? (long)py * screen.width + px : -1;
}

/* Adds a number for each pixel of a block to the pixel's counter. */
void add_to_counters(global int *counters, const Region *region, int block, Screen screen, intl added)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, region->x + FIRST_X(block), region->y + FIRST_Y(block), lane);
        if (at >= 0)
            counters[at] += int_lane(added, lane);
    }
}

#if LANES == 16
/* Does the whole block at (x, y) lie in the picture? */
#define IS_WHOLE(screen, x, y) ((x) + BLOCK <= (screen).width && (y) + BLOCK <= (screen).height)

float16 block_depths(Screen screen, global const float *depth, int x, int y)
{
    global const float *at = depth + (size_t)y * screen.width + x;
    return (float16)(vload4(0, at), vload4(0, at + screen.width), vload4(0, at + 2 * (size_t)screen.width),
                     vload4(0, at + 3 * (size_t)screen.width));
}
#endif

/* Nearness that the picture shows at the block at (x, y) until now; EMPTY outside the picture */
INLINED floatl nearness_of_block(Screen screen, global const float *depth, int x, int y)
{
    floatl so_far = EMPTY;
#if LANES == 16
    if (IS_WHOLE(screen, x, y)) {
        const floatl z = block_depths(screen, depth, x, y);
        return select_lanes(z == z, DEPTH_OF(screen.perspective, z), so_far);
    }
#endif
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, x, y, lane);
        if (at >= 0)
            set_float_lane(so_far, lane, drawn_nearness(screen, depth[at]));
    }
    return so_far;
}

INLINED void begin_region(Region *region, int x, int y)
{
    region->x = x;
    region->y = y;
    for (int block = 0; block < BLOCKS; block++) {
        region->nearness[block] = EMPTY;
        region->owner[block] = -1;
        region->farthest[block] = EMPTY;
    }
}

INLINED void begin_in_picture(Region *region, const Picture *picture, int x, int y)
{
    begin_region(region, x, y);
    if (picture->blank)
        return;
    for (int block = 0; block < BLOCKS; block++) {
        const floatl so_far =
            nearness_of_block(picture->screen, picture->depth, x + FIRST_X(block), y + FIRST_Y(block));
        region->nearness[block] = so_far;
        region->farthest[block] = least_lane(so_far);
    }
}

#if LANES == 16
/* Writes a row of a block, 4 pixels together: vstore4 would store byte by byte. */
#define WRITE_ROW(at, l, a, b, c, d)                                                                           \
    {                                                                                                          \
        vstore4(z.l, 0, picture->depth + (at));                                                                \
        ((global Word *)(picture->valid + (at)))->bytes = as_uint(convert_uchar4(seen.l));                     \
        WRITE_COLORS(at, a, b, c, d)                                                                           \
    }
#if COLOR_BYTES == 1
#define WRITE_COLORS(at, a, b, c, d)                                                                           \
    {                                                                                                          \
        global Word *bytes = (global Word *)(picture->color + 3 * (at));                                       \
        bytes[0].bytes = word.a | word.b << 24;                                                                \
        bytes[1].bytes = word.b >> 8 | word.c << 16;                                                           \
        bytes[2].bytes = word.c >> 16 | word.d << 8;                                                           \
    }
#else
#define WRITE_COLORS(at, a, b, c, d)                                                                           \
    vstore3((float3)(red.a, green.a, blue.a), 0, picture->color + 3 * (at));                                   \
    vstore3((float3)(red.b, green.b, blue.b), 0, picture->color + 3 * (at) + 3);                               \
    vstore3((float3)(red.c, green.c, blue.c), 0, picture->color + 3 * (at) + 6);                               \
    vstore3((float3)(red.d, green.d, blue.d), 0, picture->color + 3 * (at) + 9);
#endif

/* Writes all pixels of the block at (x, y); z: their depths, NaN where empty. */
INLINED void write_whole_block(const Picture *picture, floatl z, int x, int y, Color shade)
{
    const int width = picture->screen.width;
    const int16 mine = z == z, seen = mine & 1;
    const float16 red = select_lanes(mine, clamp(shade.r, 0.0f, 1.0f), (float16)0.0f) * CHANNEL_MAX;
    const float16 green = select_lanes(mine, clamp(shade.g, 0.0f, 1.0f), (float16)0.0f) * CHANNEL_MAX;
    const float16 blue = select_lanes(mine, clamp(shade.b, 0.0f, 1.0f), (float16)0.0f) * CHANNEL_MAX;
#if COLOR_BYTES == 1
    const uint16 word = as_uint16(to_intl(red + 0.5f) | to_intl(green + 0.5f) << 8 | to_intl(blue + 0.5f) << 16);
#endif
    const size_t at = (size_t)y * width + x;
    WRITE_ROW(at, s0123, s0, s1, s2, s3)
    WRITE_ROW(at + width, s4567, s4, s5, s6, s7)
    WRITE_ROW(at + 2 * width, s89ab, s8, s9, sa, sb)
    WRITE_ROW(at + 3 * width, scdef, sc, sd, se, sf)
}
#endif

/* Writes pixels of a block one by one: the pixels in `mine`, and in a blank picture also the other pixels. z: depths of
 * the pixels. Returns which pixels of `mine` are visible now. */
OUTLINED intl write_single_pixels(const Picture *picture, floatl z, intl mine, int x, int y, Color shade)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(picture->screen, x, y, lane);
        const int is_mine = int_lane(mine, lane) != 0, blank = picture->blank;
        if (at < 0 || !(is_mine || blank) || (!blank && float_lane(z, lane) >= picture->depth[at])) {
            set_int_lane(mine, lane, 0); /* hidden, even at equal depths: conversion to nearness and back rounds */
            continue;
        }
        picture->depth[at] = float_lane(z, lane);
        picture->valid[at] = is_mine;
        const float3 one = rounded_channel(clamp(color_lane(shade, lane), 0.0f, 1.0f) * CHANNEL_MAX);
        write_pixel(picture->color + 3 * at, is_mine ? one : (float3)(0.0f));
    }
    return mine;
}

/* Writes a block of the region to the picture; shade: colours in [0, 1]. Returns at which pixels the region's
 * primitives are visible now. */
INLINED intl write_block(const Region *region, int block, const Picture *picture, Color shade)
{
    const int x = region->x + FIRST_X(block), y = region->y + FIRST_Y(block);
    const intl mine = region->owner[block] >= 0;
    const floatl n = region->nearness[block], z = select_lanes(mine, DRAWN_DEPTH(picture->screen, n), (floatl)NAN);
#if LANES == 16
    if (IS_WHOLE(picture->screen, x, y) &&
        (picture->blank || !any_lane(!mine | (z >= block_depths(picture->screen, picture->depth, x, y))))) {
        write_whole_block(picture, z, x, y, shade);
        return mine;
    }
#endif
    return write_single_pixels(picture, z, mine, x, y, shade);
}

/* Enters a block's `written` pixels into the G-buffer. normal: as a colour 0.5 + 0.5 (x, y, z) */
INLINED void enter_block(GBuffer gbuffer, intl written, const Region *region, int block, const Picture *picture,
                         Color normal)
{
#if GBUFFER
    for (int lane = 0; lane < LANES; lane++)
        if (int_lane(written, lane)) {
            const long at = pixel_of(picture->screen, region->x + FIRST_X(block), region->y + FIRST_Y(block), lane);
            enter_pixel(gbuffer, at, picture->depth[at], color_lane(normal, lane));
        }
#endif
}

INLINED void clear_region(const Picture *picture, int x, int y)
{
    const Color black = {0.0f, 0.0f, 0.0f};
    const int end = min(x + REGION, picture->screen.width);
    for (int row = y; row < min(y + REGION, picture->screen.height); row++)
        for (int column = x; column < end; column += LANES) {
            const size_t at = (size_t)row * picture->screen.width + column;
            if (column + LANES <= end) {
                store_lanes((floatl)NAN, picture->depth + at);
                store_bytes((WIDE(uchar))0, picture->valid + at);
                write_color(picture->color + 3 * at, black);
                continue;
            }
            for (int i = 0; i < end - column; i++) {
                picture->depth[at + i] = NAN;
                picture->valid[at + i] = 0;
                write_pixel(picture->color + 3 * (at + i), (float3)(0.0f));
            }
        }
}
#endif
