/* Finds the area in which samples may be invented: all pixels except those in a disc of radius `reach` that contains no
 * sample.
 *
 * This is a morphological closing by a disc: a dilation of the samples, then an erosion of the result. Both find the
 * pixels around which a disc contains some pixel of a given kind. The first of two passes finds the distance to such a
 * pixel within each column; the second searches along the row for a column whose distance lies in the disc.
 *
 * marks: a plane of bytes (plane.h). If `wanted` is 1, pixels with any of `bits` are searched for; if it is 0, pixels
 * of the image with none of them. distances: a plane, at most reach + 1 pixels. near: a plane, 1 where the disc
 * contains such a pixel. Work-item: LANES columns (column_distances), `strip` packets of a row (within_disc). Cost: at
 * most O(pixels * reach); a packet's search ends once it has found a pixel for all lanes. Determinism: kernels read
 * only finished planes.
 */
#include "cleaning/plane.h"

kernel void column_distances(global const uchar *marks, int bits, int wanted, global int *distances,
                             ImagePlane plane, int reach)
{
    const int x = get_global_id(0) * LANES, rows = plane.height + 2 * ABOVE;
    if (x >= plane.pitch)
        return;
    const intl is_column = (x + lane_index >= (intl)ASIDE) & IN_IMAGE(plane, x);
    const intl beyond = reach + 1;
    intl distance = beyond;
    for (int row = 0; row < rows; row++) {
        const size_t at = (size_t)row * plane.pitch + x;
        distance = min(distance + 1, beyond);
        if (IS_ROW_OF_IMAGE(plane, row)) {
            const intl has = (load_bytes(marks + at) & bits) != 0;
            distance = select_lanes(is_column & (wanted ? has : !has), (intl)0, distance);
        }
        store_lanes(distance, distances + at);
    }
    for (int row = rows - 2; row >= 0; row--) {
        const size_t at = (size_t)row * plane.pitch + x;
        distance = min(distance + 1, load_lanes(distances + at));
        store_lanes(distance, distances + at);
    }
}

kernel void within_disc(global const int *distances, global uchar *near, ImagePlane plane, int strip, int reach)
{
    EACH_PACKET(plane, x, row)
    {
        const size_t at = (size_t)row * plane.pitch + x;
        intl found = 0;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            const intl is_column = IN_IMAGE(plane, x);
            for (int off = 0; off <= reach && any_lane(is_column & !found); off++) {
                const int most = reach * reach - (off ? off * off - off + 1 : 0); /* disc, half a pixel wider in x */
                if (x - off + LANES > ASIDE) {
                    const intl left = load_lanes(distances + at - off);
                    found |= left * left <= most;
                }
                if (x + off < ASIDE + plane.width) {
                    const intl right = load_lanes(distances + at + off);
                    found |= right * right <= most;
                }
            }
        }
        store_bytes(to_ucharl(select_lanes(found, (intl)1, (intl)0)), near + at);
    }
}
