#ifndef WARP_HITS_H
#define WARP_HITS_H
/* Hits. A pixel's hit is the target nearness of the first surface met by its line (or ray) at the pixel, or EMPTY.
 *
 * The last bit of the nearness is 1 if the surface turns a side to the target that is not shown: the surface is not
 * drawn there, but hides everything behind it.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"

#define OWN_RAY 2 /* bit: the pixel's own ray meets a patch (patches.cl), at the hit's nearness or farther away */
#define PACKED_HIT(nearness, hides) as_floatl((as_intl(nearness) & ~1) | (hides))
#define IS_VISIBLE_HIT(hit) (IS_HIT(hit) & ((as_intl(hit) & 1) == 0))
/* Stores a hit, given as bits, unless the stored hit is nearer. The bits of positive floats, as ints, have the order of
 * the floats; the bits of negative floats have the reverse order. */
void put_nearest(global float *pixel, int hit)
{
    if (hit > 0)
        atomic_max((volatile global int *)pixel, hit);
    else
        atomic_min((volatile global uint *)pixel, (uint)hit);
}

/* Stores a hit of a pixel's own ray unless the stored hit is nearer, and sets the pixel's bit OWN_RAY. */
void put_own_hit(global float *pixel, float met, int hides)
{
    put_nearest(pixel, (as_int(met) & ~(OWN_RAY | 1)) | OWN_RAY | hides);
    atomic_or((volatile global int *)pixel, OWN_RAY);
}
#endif
