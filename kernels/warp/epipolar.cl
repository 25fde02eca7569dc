/* The epipolar sweep: the O(n^2) inverse warp (Schaufler & Priglinger 1999, sections 4 and 5).
 *
 * An epipolar plane cuts each of the two images in a line. A line of the source is walked from the epipole outwards, or
 * towards the epipole's antipode. A ray of the target passes the samples in this order, so it sees the first segment
 * (between two samples) that crosses it. The pixels to which a connected run of samples has given hits form one
 * interval of the target line, and a step of the walk goes on to the next sample or extends this interval by a pixel.
 * So the number of steps is the sum of samples and pixels, not their product.
 *
 * The homogeneous epipoles b (target) and e (source) keep their signs, so that lines from an epipole, to an antipode,
 * or from infinity are one case. An epipole (u, v, w) and a pixel give the direction D = pixel * w - (u, v). The source
 * is walked along +D. In the target, a segment that extends the interval along -D shows the surface's front.
 *
 * Deviations from the paper: There is not a line for each border pixel, but one for each pixel of the column (or row)
 * farthest from the epipole; where the distance to the epipole halves, every second line ends. A pixel belongs to the
 * nearest line, which is computed, not marked by a flag. No depth test is needed, even where the surface is torn, as a
 * pixel keeps its first hit. A hit belongs to a ray on the line, near the pixel; resolve.cl uses it to find the hit of
 * the pixel's own ray.
 *
 * counters: with COUNTERS, (packet_count, 2) the samples and the pixels that each packet visited.
 * Work-item: LANES lines of one group, or SEGMENT pixels of one line (segments.h). Cost: source samples + target pixels
 * for each line; lines <= about 2 (width + height).
 * Determinism: a pixel is written by at most one lane.
 *
 * hits: (dst_height, dst_pitch), hits.h. The host fills them with EMPTY, unless ALIGNED is 1 and SEGMENT is 0. From
 * index `spare` on, LANES more floats for each work-item take the values of lanes that have no pixel to write. ALIGNED:
 * all lines run along rows or columns of both images (stereo, light fields) and pass through the pixels' centres, so
 * their hits are the pixels' own. The packets hold a line for each row (or column), in order. A packet of whole lines
 * first writes EMPTY to its lines in `hits`, and in the plane of hits on margins, which begins `plane` floats later
 * (patches.cl; 0: no margins). EDGES: the surface is followed from edge to edge of its triangles (walk_edges.h), which
 * is exact for the line. Without EDGES, aligned lines run from sample to sample (walk_samples.h); other lines run from
 * column to column (or row to row, walk_columns.h), which costs about half as much, but leaves out the surface's
 * corners between the columns.
 */
#include "warp/interval.h"
#if SEGMENT
#include "warp/segments.h"
#endif
#if EDGES
#include "warp/walk_edges.h"
#define WALK walk_edges
#elif ALIGNED
#include "warp/walk_samples.h"
#define WALK walk_samples
#else
#include "warp/walk_columns.h"
#define WALK walk_columns
#endif

#if ALIGNED && !SEGMENT
/* Writes EMPTY to the rows (or columns) of a packet, from number `first` on. */
INLINED void clear_lines(global float *hits, int first, int along, PixelMap map)
{
    const int rows = along ? map.dst_height : min(LANES, map.dst_height - first), columns = along ? 1 : map.dst_width;
    global float *from = hits + (along ? first : (size_t)first * map.dst_pitch);
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x += LANES) /* rows have room for whole packets */
            store_lanes((floatl)EMPTY, from + (size_t)y * map.dst_pitch + x);
}
#endif

/* Walks one packet of a group's lines. Returns the number of visited samples, and that of visited pixels. */
OUTLINED uint2 sweep_packet(Grid grid, global float *hits, int plane, int spare, LineGroup group, int packet, PixelMap map, int sides, float nearest,
                            float farthest, global const float *bounds)
{
    SweepLines line = sweep_lines(group, map, packet, nearest, farthest);
#if ALIGNED && !SEGMENT
    clear_lines(hits, packet * LANES, line.along, map);
    if (plane)
        clear_lines(hits + plane, packet * LANES, line.along, map);
#endif
    if (!any_lane((line.low <= line.high) & (line.from <= line.to)))
        return (uint2)(0, 0);
    uint samples = 0;
#if SEGMENT
    samples += clip_walk(&line, bounds, map);
#endif
    const int front_is_up = group.side < 0; /* -D points towards larger pixels */
    HitWriter writer;
    writer.hits = hits;
    writer.spare = spare + packet * LANES;
    writer.up_hides = !(sides & (front_is_up ? SHOWS_FRONT : SHOWS_BACK));
    writer.down_hides = !(sides & (front_is_up ? SHOWS_BACK : SHOWS_FRONT));
    writer.pixels = 0;
    samples += WALK(grid, line, group, map, &writer);
    return (uint2)(samples, writer.pixels);
}

kernel void epipolar_sweep(global const float *surface, global float *hits, global const LineGroup *groups,
                           int group_count, int packet_count, PixelMap map, int sides, float nearest,
                           float farthest, int plane, int spare
#if SEGMENT
                           , global const float *bounds
#endif
                           COUNTERS_PARAMETER(uint))
{
    const int id = get_global_id(0);
    if (id >= packet_count)
        return;
    /* Runtimes give neighbouring work-items to one thread, and neighbouring lines take equally long. This order gives
     * each thread both long and short lines. */
    const int half_ = (packet_count + 1) / 2;
    const int packet = id < half_ ? 2 * id : 2 * (id - half_) + 1;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
#if !SEGMENT
    global const float *bounds = 0;
#endif
    const uint2 visited = sweep_packet(grid, hits, plane, spare, groups[group_of(groups, group_count, packet)], packet, map, sides, nearest, farthest, bounds);
#if COUNTERS
    counters[2 * packet] = visited.x;
    counters[2 * packet + 1] = visited.y;
#endif
}
