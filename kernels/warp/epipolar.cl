/* The epipolar sweep: the O(n^2) inverse warp (Schaufler & Priglinger 1999, sections 4 and 5).
 *
 * Epipolar planes cut both images in lines. Along a source line, walked from the epipole outwards (from its antipode
 * inwards), samples come in the order in which a ray of the target passes them, so the ray sees the first segment that
 * crosses it. The pixels that a connected run of samples has settled are one interval of the target line, and a step of
 * the walk extends the interval at either end. So steps add up to samples plus pixels, not to their product.
 *
 * The homogeneous epipoles b (target) and e (source) keep their signs, so that epipole, antipode, infinity and all four
 * walking orders are one case. With D = pixel * w - (u, v), the source is walked along +D; in the target, segments that
 * extend an interval along -D show their front.
 *
 * Deviations from the paper: Lines are laid where needed, one per pixel of the farthest column (or row) and every
 * second line at each halving of the distance to the epipole, instead of one per border pixel. A pixel belongs to the
 * nearest line by arithmetic, not by a flag. The order of writing needs no depth test, even where the surface is cut.
 * The result is the nearness of the surface that the line's ray sees; resolve.cl finds the hit of the pixel's own ray
 * from it.
 *
 * counters: (packet_count, 2) samples and pixels visited, with COUNTERS.
 * Work-item: LANES lines of one group, or SEGMENT pixels of one line (segments.h). Cost: source samples + target pixels
 * a line; lines <= about 2 (width + height).
 * Determinism: a pixel is written by at most one lane.
 *
 * hits: (dst_height, dst_pitch), hits.h, filled with EMPTY at first, unless ALIGNED without SEGMENT. LANES more floats
 * for each work-item, from `spare` on, serve lanes with nothing to write. ALIGNED: all lines run along rows or columns
 * of both images (stereo, light fields) and pass through the pixels' centres, so that their hits are the pixels' own.
 * There is a line for each row (or column), and the first packet begins with the first one. A packet of whole lines
 * first writes EMPTY to its lines, and to the same lines of the margins' hits, `plane` floats further on (patches.cl;
 * 0: no margins). EDGES: the surface is followed from edge to edge of its triangles (walk_edges.h): exact for the
 * line. Otherwise aligned lines run from sample to sample (walk_samples.h), and other lines are walked from column to
 * column (row to row, walk_columns.h), which leaves out the corners between, at about half the cost.
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
/* Fills the rows (or columns) of a packet with EMPTY, from the `first` on. */
INLINED void clear_lines(global float *hits, int first, int along, PixelMap map)
{
    const int rows = along ? map.dst_height : min(LANES, map.dst_height - first), columns = along ? 1 : map.dst_width;
    global float *from = hits + (along ? first : (size_t)first * map.dst_pitch);
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x += LANES) /* rows have room for whole packets */
            store_lanes((floatl)EMPTY, from + (size_t)y * map.dst_pitch + x);
}
#endif

/* Walks a packet of a group's lines. Returns the numbers of samples and pixels visited. */
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
    /* Runtimes give neighbouring items to one thread, and neighbouring lines take equally long. This order gives each
     * thread all kinds of lines. */
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
