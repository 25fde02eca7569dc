/* Finds which points lie in an object: those that pass the tests of all views (slicing/view_volumes.h).
 *
 * points: (3, count), relative to the middle of the object's box; count is a multiple of LANES. inside: (count,) 1 for
 * points in the object, else 0. Other arrays: object.cl. Work-item: LANES points. Cost: O(points * views tested).
 * Determinism: points are independent.
 */
#include "slicing/view_volumes.h"

kernel void find_inside(global const float *points, global uchar *inside, global const float *matrices,
                        global const int *sizes, global const float *maps, global const float *reaches,
                        global const int *order, int view_count, int unknown, float outline, int count
#if RIBBONS
                        , global const int *firsts, global const float *ribbons
#endif
)
{
    const int i = get_global_id(0) * LANES;
    if (i >= count)
        return;
    const Views views = {
        .count = view_count, .matrices = matrices, .sizes = sizes, .maps = maps, .reaches = reaches, .order = order, .unknown = unknown,
        .outline = outline,
#if RIBBONS
        .firsts = firsts, .ribbons = ribbons,
#endif
    };
    const WorldRay place = {{load_lanes(points + i), 0.0f}, {load_lanes(points + count + i), 0.0f},
                            {load_lanes(points + 2 * (size_t)count + i), 0.0f}};
    ViewRays rays;
    hold_rays(&views, &place, &rays);
    intl passed = 0, tests = 0;
    const intl found = inside_all(&views, &rays, 0.0f, -1, &passed, &tests);
    store_bytes(to_ucharl(found & 1), inside + i);
}
