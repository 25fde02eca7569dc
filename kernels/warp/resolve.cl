/* Finds each pixel's own hit from the hits of the sweep's lines, and its depth and colour.
 *
 * A line of the sweep passes within half a pixel of the pixels to which it gives hits. Aligned lines pass through the
 * pixels' centres, so their hits are the pixels' own. In other cases, if the hits at a pixel and at its neighbours lie
 * on one smooth surface, the pixel's own ray is intersected with the triangle at its line's hit (line_hits.h).
 * Otherwise (at silhouettes, cuts and rough surfaces, or if the pixel has no hit but a neighbour has one), the ray is
 * traced along its own epipolar line, in windows around the hits at the pixel and at its neighbours (candidates.h).
 * The pixels to trace are first gathered into full packets, as a trace of a packet costs the same for one pixel as for
 * all.
 *
 * hits: (dst_height, dst_pitch) of epipolar.cl or search.cl, hits.h. hit_kind: the rays to which the hits belong,
 * HITS_... in line_hits.h. plane: hits on margins (patches.cl) begin this many values later than `hits`, and the nearer
 * of a pixel's two hits counts; 0: there are no margins.
 * depth, color, valid: (dst_height, dst_width). merge: 1 if pixels that already show something nearer stay. density:
 * source pixels per target pixel, >= 1. neighbour_offset: half the side of a sample in target pixels, >= 1: a surface
 * may extend this far beyond the lines' hits. typical: a nearness of the view's surface in the target. rough: a surface
 * is rough if its neighbouring hits have at least this second difference, in target pixels. window: target pixels that
 * are traced to either side of a hit.
 * With ORIGINS: source: (dst_height, dst_width, 2) u and v in the samples' grid, NaN in holes; source_view:
 * (dst_height, dst_width) the index of the view, -1 in holes. With ORIGINS 2: classes: (dst_height, dst_width),
 * classes.h: becomes CLASS_HIDDEN where the ray meets a side of the surface that is not shown.
 * counters: with COUNTERS, (work-items, 2): cells visited by the slowest lane, times LANES; number of traced pixels.
 * Work-item: STRIP * LANES pixels of a row.
 * Cost: O(pixels): a pixel visits at most CANDIDATES * 2 * window * density columns of the source; if it misses a
 * connected surface there, CANDIDATES * 2 * WIDE_WINDOW * density columns more. Next to isolated samples (OWN_RAY), the
 * first window is FOLLOWED * density columns long.
 * Determinism: each pixel depends on the inputs alone.
 */
#include "lib/color.h"
#include "warp/candidates.h"
#include "warp/classes.h"
#include "warp/corners.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: writes the pixels' origins (view, place in the source), too; 2: also hidden pixels' classes */
#endif

/* A row of the picture, and the view that is drawn into it */
typedef struct {
    Grid grid;
    PixelMap map;
    global const channel *src_color;
    int linear, merge, y;
    global float *depth;
    global channel *color;
    global uchar *valid;
#if ORIGINS
    global float *source;
    global int *source_view;
    int view;
#endif
#if ORIGINS == 2
    global uchar *classes;
#endif
    GBuffer gbuffer;
    global const float *normals;
} PictureRow;

/* Writes the origins of the row's pixels x in the mask `written`. */
INLINED void write_origins(PictureRow row, Pixels pixels, intl written, intl x)
{
#if ORIGINS
    const intl hit = IS_HIT(pixels.n), from = select_lanes(hit, (intl)row.view, (intl)-1);
    const floatl u = select_lanes(hit, pixels.u, (floatl)NAN), v = select_lanes(hit, pixels.v, (floatl)NAN);
    const int first = int_lane(x, 0);
    if (!any_lane(!written | (x != first + lane_index))) {
        store_pairs(u, v, row.source + 2 * first);
        store_lanes(from, row.source_view + first);
        return;
    }
    for (uint left = lane_bits(written); left; left = WITHOUT_LOWEST(left)) {
        const int lane = LOWEST(left), at = int_lane(x, lane);
        vstore2((float2)(float_lane(u, lane), float_lane(v, lane)), at, row.source);
        row.source_view[at] = int_lane(from, lane);
    }
#endif
}

/* Marks the row's pixels x before high_x as hidden if their hits lie on a side that is not shown. */
INLINED void write_hidden(PictureRow row, floatl hits, intl x, int high_x)
{
#if ORIGINS == 2
    for (uint left = lane_bits(IS_HIT(hits) & !IS_VISIBLE_HIT(hits) & (x < high_x)); left; left = WITHOUT_LOWEST(left))
        row.classes[int_lane(x, LOWEST(left))] = CLASS_HIDDEN;
#endif
}

/* Writes `count` pixels of the row from x0 on, at most LANES. With merge, writes only those nearer than the picture.
 * Returns the mask of written pixels. */
INLINED intl write_pixels(PictureRow row, Pixels pixels, Color c, int x0, int count)
{
    const intl settled = IS_HIT(pixels.n);
    const floatl z = DEPTH_OF(row.map.dst_perspective, pixels.n);
    global float *depth = row.depth + x0;
    global channel *color = row.color + CHANNELS * x0;
    global uchar *valid = row.valid + x0;
    if (!row.merge && count == LANES) {
        store_lanes(select_lanes(settled, z, (floatl)NAN), depth);
        store_bytes(to_ucharl(settled & 1), valid);
        const Color none = {0.0f, 0.0f, 0.0f};
        write_color(color, select_color(settled, c, none));
        return (intl)-1;
    }
    intl written = 0;
    for (int lane = 0; lane < count; lane++) {
        const int is_settled = int_lane(settled, lane) != 0;
        const float z_new = float_lane(z, lane), z_old = row.merge ? depth[lane] : NAN;
        if (is_settled ? z_new >= z_old : row.merge)
            continue; /* the picture shows something nearer there, or this view has no hit */
        depth[lane] = is_settled ? z_new : NAN;
        valid[lane] = is_settled;
        set_int_lane(written, lane, -1);
        write_pixel(color + CHANNELS * lane, is_settled ? rounded_channel(color_lane(c, lane)) : (float3)(0.0f));
    }
    return written;
}

/* Prefetches samples and colours at the hits of a packet's first and last pixel: hardware cannot predict these
 * places. */
void prefetch_place(Grid grid, global const channel *color, floatl u, floatl v)
{
#if LANES == 16
    const intl x = clamp(to_intl(u), (intl)0, (intl)(grid.width - 1)),
               y = clamp(to_intl(v), (intl)0, (intl)(grid.height - 1));
    const intl below = min(y + 1, grid.height - 1), samples = y * grid.pitch + x,
               samples_below = below * grid.pitch + x;
    prefetch_at(grid.nearness + samples.s0);
    prefetch_at(grid.nearness + samples.sf);
    prefetch_at(grid.nearness + samples_below.s0);
    prefetch_at(grid.nearness + samples_below.sf);
    if (!CHANNELS)
        return;
    const intl texels = CHANNELS * (y * grid.width + x), texels_below = CHANNELS * (below * grid.width + x);
    prefetch_at(color + texels.s0);
    prefetch_at(color + texels.sf);
    prefetch_at(color + texels_below.s0);
    prefetch_at(color + texels_below.sf);
#endif
}

/* Traces the pixels marked `traced`, gathered into full packets. Pixels that miss the surface keep the mark, and are
 * traced once more, in wider windows. Returns the number of pixels that were traced in the first round. */
OUTLINED int trace_pixels(Pixels *pixels, int packets, global const float *hits, Grid grid, PixelMap map, int strip_x,
                         int y, int sides, int neighbour_offset, float density, float window, int connected, uint *cells)
{
    int traced = 0;
    ROLLED
    for (int is_second = 0; is_second < 2; is_second++) {
        int to_trace[(STRIP + 1) * LANES], count = 0;
        for (int p = 0; p < packets; p++)
            for (uint left = lane_bits(pixels[p].traced); left; left = WITHOUT_LOWEST(left))
                to_trace[count++] = p * LANES + LOWEST(left);
        for (int first = 0; first < count; first += LANES) {
            const intl wanted = first + lane_index < count;
            const intl x = strip_x + select_lanes(wanted, (intl)load_lanes(to_trace + first), (intl)0);
            const floatl n = trace_candidates(hits, grid, map, x, y, wanted, is_second, sides, neighbour_offset,
                                              density, window, cells);
            /* If a connected surface is met from the back, the window began behind it: that is a miss, too. */
            const intl misses = !IS_VISIBLE_HIT(n) & ((intl)(connected ? -1 : 0) | (n > EMPTY));
            for (int i = 0; i < min(count - first, LANES); i++) {
                const int p = to_trace[first + i] / LANES, lane = to_trace[first + i] % LANES;
                set_float_lane(pixels[p].n, lane, float_lane(n, i));
                set_int_lane(pixels[p].traced, lane, int_lane(misses, i));
            }
        }
        traced += is_second ? 0 : count;
    }
    return traced;
}

/* Reads the hits of a strip's pixels, from strip_x on and before high_x. On smooth surfaces, intersects the pixels' own
 * rays with the triangles at these hits. */
OUTLINED void read_strip(Pixels *pixels, PictureRow row, global const float *hits, int strip_x, int high_x, int packets, int hit_kind,
                         int neighbour_offset, float density, float typical, float rough, int sides)
{
    for (int p = 0; p < packets; p++) {
        const int x0 = strip_x + p * LANES;
        pixels[p] = read_hits(hits, row.map, x0, row.y, x0 + lane_index < high_x, hit_kind, neighbour_offset, density,
                              typical, rough);
        prefetch_place(row.grid, row.src_color, pixels[p].u, pixels[p].v);
    }
    for (int p = 0; p < packets; p++) {
        if (any_lane(pixels[p].smooth))
            intersect_at_hits(&pixels[p], row.grid, row.map, to_floatl(strip_x + p * LANES + lane_index), row.y, hit_kind, sides);
        else if (hit_kind != HITS_OF_PIXELS)
            pixels[p].n = EMPTY;
    }
}

/* Writes the pixels of a strip from their hits, or from hits on margins where these are nearer. margins: the row's hits
 * on margins, or 0 */
OUTLINED void write_strip(PictureRow row, Pixels *pixels, int strip_x, int high_x, int packets, int hit_kind,
                          global const float *hits, global const float *margins)
{
    for (int p = 0; p < packets; p++) {
        const int x0 = strip_x + p * LANES;
        const intl x = x0 + lane_index;
        intl on_margins = 0;
        if (ORIGINS == 2 && hit_kind != HITS_WITHOUT_PARALLAX)
            write_hidden(row, load_lanes(hits + x0), x, high_x);
        if (margins) {
            const floatl margin = load_lanes(margins + x0);
            write_hidden(row, margin, x, high_x);
            on_margins = (margin > pixels[p].n) & IS_VISIBLE_HIT(margin) & (x < high_x);
            pixels[p].n = max_lanes(margin, pixels[p].n);
        }
        pixels[p].n = select_lanes(IS_VISIBLE_HIT(pixels[p].n), pixels[p].n, (floatl)EMPTY);
        if (row.merge && !any_lane(IS_HIT(pixels[p].n)))
            continue;
        if (hit_kind != HITS_OF_PIXELS || any_lane(on_margins))
            find_place(&pixels[p], row.map, to_floatl(x), row.y);
        const Corners there = corners_at(&pixels[p], row.grid, row.map, row.linear, on_margins, to_floatl(x), row.y);
        const Color c = interpolate_color(there, row.map, row.src_color, row.linear);
        pixels[p].n = select_lanes(IS_BEFORE(row.map.dst_perspective, pixels[p].n), pixels[p].n, (floatl)EMPTY);
        const intl written = write_pixels(row, pixels[p], c, x0, min(high_x - x0, LANES)) & (x < high_x);
        write_origins(row, pixels[p], written, x);
        enter_pixels(row.gbuffer, row.normals, row.depth, (size_t)row.y * row.map.dst_width, there, written, x);
    }
}

kernel void resolve(global const float *surface, global const float *hits, global const channel *src_color,
                    global float *depth, global channel *color, global uchar *valid, PixelMap map, int sides,
                    int linear, int merge, int low_x, int high_x, int low_y, int high_y, int hit_kind, float density,
                    int neighbour_offset, float typical, float rough, float window, int connected, int plane
#if ORIGINS
                    ,
                    global float *source, global int *source_view, int view
#endif
#if ORIGINS == 2
                    ,
                    global uchar *classes
#endif
                    COUNTERS_PARAMETER(uint) GBUFFER_PARAMETERS NORMALS_PARAMETER(float))
{
    const int y = low_y + get_global_id(1);
    const int strip_x = low_x + get_global_id(0) * (STRIP * LANES);
    if (y >= high_y || strip_x >= high_x)
        return;
    const int packets = STRIP == 1 ? 1 : min(STRIP, (high_x - strip_x + LANES - 1) / LANES); /* GPUs: always 1 */
    const size_t first = (size_t)y * map.dst_width;
    const PictureRow row = {GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT),
                            map,
                            src_color,
                            linear,
                            merge,
                            y,
                            depth + first,
                            color + CHANNELS * first,
                            valid + first,
#if ORIGINS
                            source + 2 * first,
                            source_view + first,
                            view,
#endif
#if ORIGINS == 2
                            classes + first,
#endif
                            GBUFFER_VALUE,
                            NORMALS_ARGUMENT(float)};
    Pixels pixels[STRIP];
    read_strip(pixels, row, hits, strip_x, high_x, packets, hit_kind, neighbour_offset, density, typical, rough, sides);
    uint cells = 0;
    int traced = 0;
    if (hit_kind == HITS_OF_LINES)
        traced = trace_pixels(pixels, packets, hits, row.grid, map, strip_x, y, sides, neighbour_offset, density, window,
                              connected, &cells);
    global const float *own = hits + (size_t)y * map.dst_pitch;
    write_strip(row, pixels, strip_x, high_x, packets, hit_kind, own, plane ? own + plane : (global const float *)0);
#if COUNTERS
    const int across = (high_x - low_x + STRIP * LANES - 1) / (STRIP * LANES);
    const int item = get_global_id(1) * across + get_global_id(0);
    counters[2 * item] = cells * LANES;
    counters[2 * item + 1] = traced;
#endif
}
