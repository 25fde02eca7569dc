#ifndef WARP_HITS_H
#define WARP_HITS_H
/* The hit of a line in a pixel: the target nearness of the surface that it meets first there, EMPTY if it meets none.
 *
 * The last bit of the nearness is 1 if that is a side that is not shown: nothing is seen there, but the surface hides
 * what lies behind it.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"

#define PACKED_HIT(nearness, hides) as_floatl((as_intl(nearness) & ~1) | (hides))
#define IS_VISIBLE_HIT(hit) (IS_HIT(hit) & ((as_intl(hit) & 1) == 0))
#endif
