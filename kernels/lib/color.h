/* Colour of LANES pixels: three channels, interleaved, uchar (0 to 255) or float. */
#include "lib/channel.h"
#include "lib/lanes.h"

typedef struct {
    floatl r, g, b;
} Color;

#if COLOR_BYTES == 1

/* Four bytes at once, one of them a neighbour's: the image has at least four, and the last pixel is read shifted. */
#define WORD(l) as_uint(vload4(0, image + offset.s##l))
Color read_color(global const uchar *image, intl pixel, int pixels)
{
    const intl offset = min(3 * pixel, (intl)(3 * pixels - 4));
#if LANES == 16
    const uintl loaded = (uint16)(WORD(0), WORD(1), WORD(2), WORD(3), WORD(4), WORD(5), WORD(6), WORD(7), WORD(8),
                                  WORD(9), WORD(a), WORD(b), WORD(c), WORD(d), WORD(e), WORD(f));
#else
    const uintl loaded = as_uint(vload4(0, image + offset));
#endif
    const intl word = as_intl(loaded >> as_uintl(8 * (3 * pixel - offset)));
    Color c;
    c.r = to_floatl(word & 255);
    c.g = to_floatl((word >> 8) & 255);
    c.b = to_floatl((word >> 16) & 255);
    return c;
}

#define PUT(l)                                                                                                 \
    if (0x##l < count)                                                                                         \
        vstore3(as_uchar4(word.s##l).xyz, 0, image + 3 * 0x##l);
/* Writes the first `count` lanes from pixel `image` on; rounds to nearest. */
void write_color(global uchar *image, Color c, int count)
{
    const intl word = to_intl(c.r + 0.5f) | (to_intl(c.g + 0.5f) << 8) | (to_intl(c.b + 0.5f) << 16);
#if LANES == 16
    if (count == 16) {
        for (int four = 0; four < 4; four++) {
            const uchar16 p = as_uchar16(four == 0 ? word.s0123 : four == 1 ? word.s4567 : four == 2 ? word.s89ab : word.scdef);
            vstore8(p.s01245689, 0, image + 12 * four);
            vstore4(p.sacde, 0, image + 12 * four + 8);
        }
    } else {
        EACH_LANE(PUT)
    }
#else
    vstore3(as_uchar4(word).xyz, 0, image);
#endif
}
#else

Color read_color(global const float *image, intl pixel, int pixels)
{
    const intl at = 3 * pixel, green = at + 1, blue = at + 2;
    Color c;
    c.r = (floatl)(gather(image, at));
    c.g = (floatl)(gather(image, green));
    c.b = (floatl)(gather(image, blue));
    return c;
}

#define PUT(l)                                                                                                 \
    if (0x##l < count)                                                                                         \
        vstore3((float3)(c.r.s##l, c.g.s##l, c.b.s##l), 0, image + 3 * 0x##l);
void write_color(global float *image, Color c, int count)
{
#if LANES == 16
    EACH_LANE(PUT)
#else
    vstore3((float3)(c.r, c.g, c.b), 0, image);
#endif
}
#endif
