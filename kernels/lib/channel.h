#ifndef LIB_CHANNEL_H
#define LIB_CHANNEL_H
/* The type of a colour channel: uchar (0 to 255) or float. It is a macro, so that the host sees the real type of a
 * kernel's arguments. */
#ifndef COLOR_BYTES
#define COLOR_BYTES 1 /* bytes per channel: 1 (uchar) or 4 (float) */
#endif
#ifndef CHANNELS
#define CHANNELS 3 /* number of a colour's channels; 0: images have only depth, and no colour is read or written */
#endif
#if COLOR_BYTES == 1
#define channel uchar
#define CHANNEL_MAX 255.0f
#define to_channel(value) convert_uchar_sat_rte(value)
#define to_channels(values) convert_uchar4_sat_rte(values) /* converts a float4 as fast as one float */
#define rounded_channel(value) floor((value) + 0.5f) /* rounds halves up, as `write_color` does */
#else
#define channel float
#define CHANNEL_MAX 1.0f
#define to_channel(value) (value)
#define to_channels(values) (values)
#define rounded_channel(value) (value)
#endif
#endif
