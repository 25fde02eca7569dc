#ifndef WARP_HITS_H
#define WARP_HITS_H
/* The hit of a line in a pixel: the target nearness of the surface that it meets first there, EMPTY if it meets none.
 *
 * The last bit of the nearness is 1 if that is a side that is not shown: nothing is seen there, but the surface hides
 * what lies behind it.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"

#define OWN_RAY 2 /* bit: the pixel's own ray meets something, there or farther (patches.cl) */
#define PACKED_HIT(nearness, hides) as_floatl((as_intl(nearness) & ~1) | (hides))
#define IS_VISIBLE_HIT(hit) (IS_HIT(hit) & ((as_intl(hit) & 1) == 0))
/* Puts a hit, by its bits, there unless what is there is nearer. Floats are ordered as ints are, below 0 the other way
 * round. */
void put_nearest(global float *pixel, int hit)
{
    if (hit > 0)
        atomic_max((volatile global int *)pixel, hit);
    else
        atomic_min((volatile global uint *)pixel, (uint)hit);
}

/* Puts a hit of a pixel's own ray there, unless what is there is nearer, and tells that there is one. */
void put_own_hit(global float *pixel, float met, int hides)
{
    put_nearest(pixel, (as_int(met) & ~(OWN_RAY | 1)) | OWN_RAY | hides);
    atomic_or((volatile global int *)pixel, OWN_RAY);
}
#endif
