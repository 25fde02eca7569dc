#ifndef LIB_COLOR_H
#define LIB_COLOR_H
/* Colours of LANES pixels: three interleaved channels, uchar (0 to 255) or float. */
#include "lib/channel.h"
#include "lib/lanes.h"

typedef struct {
    floatl r, g, b;
} Color;

/* Reads RGBA texels, each as a 32-bit integer. */
#define texels_at(texels, at) as_intl((uintl)(gather(texels, at)))

/* The colour in a 32-bit integer: red in the lowest byte, then green and blue */
INLINED Color color_of(intl word)
{
    const Color c = {to_floatl(word & 255), to_floatl((word >> 8) & 255), to_floatl((word >> 16) & 255)};
    return c;
}

INLINED void add_color(Color *sum, floatl weight, Color c)
{
    sum->r += weight * c.r;
    sum->g += weight * c.g;
    sum->b += weight * c.b;
}

INLINED Color color_times(Color c, floatl by)
{
    const Color made = {by * c.r, by * c.g, by * c.b};
    return made;
}

INLINED Color select_color(intl mask, Color yes, Color no)
{
    const Color c = {select_lanes(mask, yes.r, no.r), select_lanes(mask, yes.g, no.g), select_lanes(mask, yes.b, no.b)};
    return c;
}

#define color_lane(c, lane) (float3)(float_lane((c).r, lane), float_lane((c).g, lane), float_lane((c).b, lane))

/* An access through this struct is one instruction at any address; vload4 and vstore4 of uchar go byte by byte. */
typedef struct __attribute__((packed)) {
    uint bytes;
} Word;

#if CHANNELS == 0
INLINED Color read_color(global const channel *image, intl pixel, int pixels)
{
    const Color none = {0.0f, 0.0f, 0.0f};
    return none;
}

INLINED float3 read_pixel(global const channel *image)
{
    return (float3)(0.0f);
}

INLINED void write_color(global channel *image, Color c)
{
}

INLINED void write_pixel(global channel *image, float3 color)
{
}
#elif COLOR_BYTES == 1
/* Reads four bytes for each pixel: its three channels and one byte of the next pixel. At the last pixel, which has no
 * next pixel, reading starts one byte earlier, and the bytes are shifted; an image has at least four bytes. */
#if LANES == 16
#define WORD(l) ((global const Word *)(image + offset.s##l))->bytes
#define WORDS                                                                                                  \
    (uint16)(WORD(0), WORD(1), WORD(2), WORD(3), WORD(4), WORD(5), WORD(6), WORD(7), WORD(8), WORD(9),         \
             WORD(a), WORD(b), WORD(c), WORD(d), WORD(e), WORD(f))
#else
#define WORDS as_uint(vload4(0, image + offset))
#endif

INLINED Color read_color(global const uchar *image, intl pixel, int pixels)
{
    const intl offset = min(3 * pixel, (intl)(3 * pixels - 4));
    const intl word = as_intl(WORDS >> as_uintl(8 * (3 * pixel - offset)));
    return color_of(word);
}

INLINED float3 read_pixel(global const uchar *image)
{
    return convert_float3(vload3(0, image));
}

/* Writes LANES pixels, from `image` on. Channels are rounded to the nearest value. */
INLINED void write_color(global uchar *image, Color c)
{
    const intl word = to_intl(c.r + 0.5f) | (to_intl(c.g + 0.5f) << 8) | (to_intl(c.b + 0.5f) << 16);
#if LANES == 16
    const uchar16 a = as_uchar16(word.s0123), b = as_uchar16(word.s4567), c_ = as_uchar16(word.s89ab),
                  d = as_uchar16(word.scdef);
    store_bytes((uchar16)(a.s01245689, a.sacde, b.s0124), image);
    store_bytes((uchar16)(b.s5689, b.sacde, c_.s01245689), image + 16);
    store_bytes((uchar16)(c_.sacde, d.s01245689, d.sacde), image + 32);
#else
    image[0] = word;
    image[1] = word >> 8;
    image[2] = word >> 16;
#endif
}

INLINED void write_pixel(global uchar *image, float3 color)
{
    const uchar4 c = to_channels((float4)(color, 0.0f));
    image[0] = c.x;
    image[1] = c.y;
    image[2] = c.z;
}
#else
INLINED Color read_color(global const float *image, intl pixel, int pixels)
{
    const Color c = {(floatl)(gather(image, 3 * pixel)), (floatl)(gather(image, 3 * pixel + 1)),
                     (floatl)(gather(image, 3 * pixel + 2))};
    return c;
}

INLINED float3 read_pixel(global const float *image)
{
    return vload3(0, image);
}

INLINED void write_color(global float *image, Color c)
{
#if LANES == 16
#define PUT(l) vstore3((float3)(c.r.s##l, c.g.s##l, c.b.s##l), 0, image + 3 * 0x##l);
    EACH_LANE(PUT)
#else
    vstore3((float3)(c.r, c.g, c.b), 0, image);
#endif
}

INLINED void write_pixel(global float *image, float3 color)
{
    vstore3(color, 0, image);
}
#endif

/* Writes the first `count` of LANES pixels. */
INLINED void write_first(global channel *image, Color c, int count)
{
    if (count >= LANES)
        write_color(image, c);
    else
        for (int lane = 0; lane < count; lane++)
            write_pixel(image + CHANNELS * lane, rounded_channel(color_lane(c, lane)));
}
#endif
