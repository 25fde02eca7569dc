#ifndef WARP_CANDIDATES_H
#define WARP_CANDIDATES_H
/* Traces pixels' own rays in windows of their epipolar lines. Each window surrounds a candidate: the hit that the sweep
 * stored for the pixel or for one of its neighbours.
 */
#define CANDIDATES 9 /* greatest number of hits that are read for a pixel; 5 of them unless IS_ZOOMED */
#define WINDOWS (CANDIDATES - 1)
#include "warp/line_hits.h"

#define WIDE_WINDOW 12.0f /* replaces `window` when a ray is traced again: past a crest, the next slope may be far */

#define FOLLOWED 256.0f /* target pixels: length of the first window next to an isolated sample */

#define SORT(i, j)                                                                                             \
    {                                                                                                          \
        const floatl first = min_lanes(places[i], places[j]), last = max_lanes(places[i], places[j]);          \
        places[i] = first;                                                                                     \
        places[j] = last;                                                                                      \
    }
#define SORT_NINE                                                                                              \
    SORT(0, 3) SORT(1, 7) SORT(2, 5) SORT(4, 8) SORT(0, 7) SORT(2, 4) SORT(3, 8) SORT(5, 6) SORT(0, 2)         \
    SORT(1, 3) SORT(4, 5) SORT(7, 8) SORT(1, 4) SORT(3, 6) SORT(5, 7) SORT(0, 1) SORT(2, 4) SORT(3, 5)         \
    SORT(6, 8) SORT(2, 3) SORT(4, 5) SORT(6, 7) SORT(1, 2) SORT(3, 4) SORT(5, 6)
#define SORT_FIVE                                                                                              \
    SORT(0, 3) SORT(1, 4) SORT(0, 2) SORT(1, 3) SORT(0, 1) SORT(2, 4) SORT(1, 2) SORT(3, 4) SORT(2, 3)

/* The distances along the rays' epipolar lines at which the hits of pixels x of row y lie; INFINITY without a hit. Sets
 * `meets` for hits with OWN_RAY. Beyond the image's border, the pixels at the border are read. */
INLINED floatl candidate_at(global const float *hits, PixelMap map, Rays rays, Epipolar epipolar, intl x, int y, intl *meets)
{
    global const float *row = hits + (size_t)clamp(y, 0, map.dst_height - 1) * map.dst_pitch;
    const intl at = min(max(x, (intl)0), (intl)(map.dst_width - 1));
    const floatl hit = (floatl)(gather(row, at));
    *meets = *meets | (IS_HIT(hit) & ((as_intl(hit) & OWN_RAY) != 0));
    const floatl place = distance_of(rays, epipolar, hit);
    return select_lanes(IS_HIT(hit) & isfinite_lanes(place), place, (floatl)INFINITY);
}

/* Traces the rays of the pixels x of row y through the windows around their candidates, which are wider if `is_second`.
 * Returns the same as `trace`. */
INLINED floatl trace_candidates(global const float *hits, Grid grid, PixelMap map, intl x, int y, intl wanted, int is_second,
                                int sides, int neighbour_offset, float density, float window, uint *cells)
{
    const Rays rays = rays_of(map, to_floatl(x), (floatl)y);
    const Epipolar epipolar = epipolar_of(rays, grid);
    floatl places[CANDIDATES];
    intl meets = 0, beside = 0;
    places[0] = candidate_at(hits, map, rays, epipolar, x, y, &meets);
    places[1] = candidate_at(hits, map, rays, epipolar, x - 1, y, &beside);
    places[2] = candidate_at(hits, map, rays, epipolar, x + 1, y, &beside);
    places[3] = candidate_at(hits, map, rays, epipolar, x, y - 1, &beside);
    places[4] = candidate_at(hits, map, rays, epipolar, x, y + 1, &beside);
    beside = beside & (places[0] < INFINITY);
    for (int i = 5; i < CANDIDATES; i++)
        places[i] = INFINITY;
    if (IS_ZOOMED) {
        places[5] = candidate_at(hits, map, rays, epipolar, x - neighbour_offset, y, &beside);
        places[6] = candidate_at(hits, map, rays, epipolar, x + neighbour_offset, y, &beside);
        places[7] = candidate_at(hits, map, rays, epipolar, x, y - neighbour_offset, &beside);
        places[8] = candidate_at(hits, map, rays, epipolar, x, y + neighbour_offset, &beside);
        SORT_NINE
    } else {
        SORT_FIVE
    }
    Windows windows;
    windows.radius = (is_second ? WIDE_WINDOW : window) * density;
    windows.from = places[0] - windows.radius;
    const intl rest = meets | (is_second ? beside : (intl)0);
    windows.to = places[0] + select_lanes(rest, (floatl)(FOLLOWED * density), (floatl)windows.radius);
    for (int i = 1; i < CANDIDATES; i++)
        windows.next[i - 1] = places[i];
    return trace(grid, rays, epipolar, windows, sides, wanted & (places[0] < INFINITY), cells);
}
#endif
