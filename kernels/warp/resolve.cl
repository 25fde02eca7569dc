/* From what an epipolar line saw to what each pixel's own ray sees, and its depth and colour.
 *
 * The sweep's lines pass within half a pixel of the pixels they settle; aligned ones pass through them, and there is
 * nothing more to find. Where the answers of a pixel's line and of its neighbours' lie on one smooth surface, the pixel's
 * own ray meets the triangle of the source at the line's answer.
 * What does not settle so (silhouettes, cuts, rough surfaces), and pixels beside settled ones that no line reached, are
 * traced along their own epipolar line around what their line and their neighbours' lines saw. They are gathered to
 * full packets first, so that a trace costs the same whether few pixels need it or all.
 *
 * seen: (dst_height, dst_pitch) nearness by epipolar.cl, or by search.cl. depth, color, valid: (dst_height, dst_width);
 * merge: keep what is nearer already. answers: what `seen` holds, ANSWERS_... below. density: pixels of the source over
 * one of the target, >= 1. neighbour_offset: pixels of the target over one of the source, >= 1: what a line missed of the surface
 * by half a sample is that far from what it saw. typical: some nearness that the view has in the target. rough: pixels
 * of the source; a second difference of neighbours' answers that makes a surface rough. window: pixels of the source
 * that are traced to either side of an answer.
 * counts: (work-items, 2) cells visited by the slowest lane, times LANES, and pixels traced, with COUNTERS.
 * Work-item: STRIP * LANES pixels of a row.
 * Cost: O(pixels): a pixel looks at no more than CANDIDATES * 2 * window * density columns of the source; where a connected
 * surface is not met there, once more at CANDIDATES * 2 * WIDE_WINDOW * density of them.
 * Determinism: every pixel on its own, from inputs alone.
 */
#include "lib/color.h"
#include "lib/gbuffer.h"
#include "lib/vectors.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES pixels a work-item: pixels to trace are gathered from all of them */
#endif
#ifndef ORIGINS
#define ORIGINS 0 /* 1: where in which view each pixel comes from is written, too */
#endif
#define IS_ZOOMED (neighbour_offset > 1) /* a sample is larger than a pixel: hits that far away count, too */
#define CANDIDATES 9 /* hits around a pixel; 5 unless zoomed */
#define WINDOWS (CANDIDATES - 1)
#include "warp/hits.h"
#include "warp/trace.h"

#define HITS_OF_LINES 0 /* `seen` is what lines saw that pass by the pixels */
#define HITS_OF_PIXELS 1  /* it is what the pixels' own rays saw */
#define HITS_WITHOUT_PARALLAX 2   /* nothing moves with its depth: each pixel sees its place in the source */

#define AT_EPIPOLE 1e-2f /* pixels of the target around the epipole that no line settles */
#define TOLERANCE 1e-3f  /* pixels by which a hit may lie outside its triangle: rounding, not geometry */
#define WIDE_WINDOW 12.0f       /* in place of `window` where nothing is met: past a crest, the next slope may be far */

/* What is known of a packet's pixels. */
typedef struct {
    floatl n;    /* the answer's target nearness, then the hit's; EMPTY where there is none */
    floatl u, v; /* where in the source the answer lies */
    intl smooth; /* the answer is one of a smooth surface */
    intl traced; /* to be traced, or settled if it is smooth */
} Pixels;

/* Where in the source the pixels' answers or hits lie; returns 1 / w there. */
INLINED floatl find_place(Pixels *pixels, PixelMap map, int x0, int y)
{
    const float *S = map.src_from_dst;
    const floatl x = to_floatl(x0 + lane_index), n = pixels->n, inverse = 1.0f / MAP_ROW(S, 2, x, y, n);
    pixels->u = MAP_ROW(S, 0, x, y, n) * inverse;
    pixels->v = MAP_ROW(S, 1, x, y, n) * inverse;
    return inverse;
}

/* A pixel's own answer and its neighbours', and what they say of the surface. */
INLINED Pixels read_hits(global const float *hits, PixelMap map, int x0, int y, intl inside, int hits_are, int neighbour_offset, float density,
                   float typical, float rough)
{
    const float *S = map.src_from_dst, *D = map.dst_from_src;
    global const float *here = hits + (size_t)y * map.dst_pitch + x0;
    const floatl x = to_floatl(x0 + lane_index);
    floatl n = load_lanes(here);
    const intl seen_here = inside & IS_VISIBLE_HIT(n);
    Pixels pixels;
    pixels.smooth = pixels.traced = 0;
    floatl curved = 0.0f;
    intl any_seen = 0;
    if (hits_are == HITS_OF_LINES) {
        const floatl above = y > 0 ? load_lanes(here - map.dst_pitch) : n;
        const floatl under = y + 1 < map.dst_height ? load_lanes(here + map.dst_pitch) : n;
        floatl left = x0 > 0 ? load_lanes(here - 1) : shifted_lanes(n), right = load_lanes(here + 1);
        right = pick(x0 + lane_index + 1 < map.dst_width, right, n);
        const intl above_met = IS_HIT(above), under_met = IS_HIT(under), left_met = IS_HIT(left), right_met = IS_HIT(right);
        any_seen = seen_here | IS_VISIBLE_HIT(above) | IS_VISIBLE_HIT(under) | IS_VISIBLE_HIT(left) | IS_VISIBLE_HIT(right);
        intl any_met = IS_HIT(n) | above_met | under_met | left_met | right_met;
        if (IS_ZOOMED) {
            any_met = any_met | (y >= neighbour_offset ? IS_HIT(load_lanes(here - neighbour_offset * map.dst_pitch)) : 0);
            any_met = any_met | (y + neighbour_offset < map.dst_height ? IS_HIT(load_lanes(here + neighbour_offset * map.dst_pitch)) : 0);
            any_met = any_met | (x0 >= neighbour_offset ? IS_HIT(load_lanes(here - neighbour_offset)) : 0) | IS_HIT(load_lanes(here + neighbour_offset));
        }
        curved = max_lanes(fabs(left + right - 2.0f * n), fabs(above + under - 2.0f * n));
        pixels.smooth = inside & IS_HIT(n) & above_met & under_met & left_met & right_met;
        /* A pixel whose line meets nothing may see what a neighbour's line meets. */
        pixels.traced = inside & any_met;
    }
    intl in_place = hits_are == HITS_WITHOUT_PARALLAX ? inside : (intl)0;
    if (fabs(y * D[11] - D[7]) <= AT_EPIPOLE * fabs(D[11])) /* no line there, and no parallax */
        in_place = in_place | ((fabs(x * D[11] - D[3]) <= AT_EPIPOLE * fabs(D[11])) & inside & !IS_HIT(n));
    n = pick(in_place, (floatl)typical, n);
    pixels.n = hits_are == HITS_OF_PIXELS ? pick(seen_here | in_place, n, (floatl)EMPTY) : n;
    const floatl inverse = find_place(&pixels, map, x0, y);
    if (hits_are == HITS_OF_LINES) {
        const floatl moves_by = (fabs(S[3] - pixels.u * S[11]) + fabs(S[7] - pixels.v * S[11])) * fabs(inverse);
        pixels.smooth = pixels.smooth & (curved * moves_by < rough * density);
        /* Amid a smooth side that is not shown there is nothing to see. */
        pixels.traced = pixels.traced & (any_seen | !pixels.smooth);
        pixels.smooth = pixels.smooth & seen_here;
    }
    pixels.smooth = pixels.smooth | in_place;
    pixels.traced = pixels.traced & !in_place;
    return pixels;
}

/* The pixels' own rays meet the triangles at their answers: settled is what meets them inside, EMPTY what does not. */
INLINED void intersect_at_hits(Pixels *pixels, Grid grid, PixelMap map, int x0, int y, int hits_are, int sides)
{
    const float *S = map.src_from_dst;
    const Rays rays = rays_of(map, to_floatl(x0 + lane_index), y);
    const floatl u = pixels->u, v = pixels->v;
    floatl uc = truncated(clamp_lanes(u, (floatl)0.0f, (floatl)max(grid.width - 2, 0)));
    floatl vc = truncated(clamp_lanes(v, (floatl)0.0f, (floatl)max(grid.height - 2, 0)));
    const float lowest = max(grid.height - 2, 0); /* the last row that has a next one */
    intl on_column = (intl)(grid.width == 1 ? -1 : 0), on_row = 0, beside = 0;
    if (hits_are == HITS_WITHOUT_PARALLAX) { /* on a sample or an edge: of those alone */
        const floatl column = floor_lanes(u + 0.5f), row = floor_lanes(v + 0.5f);
        on_column = (fabs(u - column) < ON_SAMPLES) & (column >= 0.0f) & (column <= (float)(grid.width - 1));
        on_row = (fabs(v - row) < ON_SAMPLES) & (row >= 0.0f) & (row <= (float)(grid.height - 1));
        uc = pick(on_column, column, uc);
        vc = pick(on_row, row, vc);
        /* What has no other column, or row, is seen on it alone. */
        beside = ((intl)(grid.width == 1 ? -1 : 0) & !on_column) | ((intl)(grid.height == 1 ? -1 : 0) & !on_row);
    }
    const intl upper = (u - uc) + (v - vc) > 1.0f;
    const intl base = to_intl(min_lanes(vc, (floatl)lowest)) * grid.pitch + to_intl(uc);
    floatl corners[4];
    gather_cells(grid.nearness, grid.height > 1 ? grid.pitch : 0, base, corners);
    if (any_lane(on_column | on_row))
        collapse_cells(corners, on_row, vc > lowest, on_column);
    const floatl q00 = corners[0], q10 = corners[1], q01 = corners[2], q11 = corners[3];
    const floatl qc = pick(upper, q11, q00);
    const intl open = IS_OPEN(grid.cut, max_lanes(qc, max_lanes(q10, q01)), min_lanes(qc, min_lanes(q10, q01)));
    Plane plane;
    plane.q = qc;
    plane.gu = pick(upper, qc - q01, q10 - qc);
    plane.gv = pick(upper, qc - q10, q01 - qc);
    plane.x = uc + pick(upper, (floatl)1.0f, (floatl)0.0f);
    plane.y = vc + pick(upper, (floatl)1.0f, (floatl)0.0f);
    floatl per_unit;
    const floatl met = intersect_plane(rays, plane, &per_unit);
    const floatl w_met = rays.w + met * S[11], inverse = 1.0f / w_met;
    const floatl u_met = (rays.u + met * S[3]) * inverse, v_met = (rays.v + met * S[7]) * inverse;

    const floatl du = u_met - uc, dv = v_met - vc, diagonal = du + dv;
    const intl in_lower = (du >= -TOLERANCE) & (dv >= -TOLERANCE) & (diagonal <= 1.0f + TOLERANCE);
    const intl in_upper = (du <= 1.0f + TOLERANCE) & (dv <= 1.0f + TOLERANCE) & (diagonal >= 1.0f - TOLERANCE);
    const intl in_triangle = (upper & in_upper) | ((!upper) & in_lower);
    /* A back has a front close before it, which a ray beside the line may meet: where both are shown, a trace tells. */
    const int shows_back = hits_are == HITS_WITHOUT_PARALLAX ? sides & SHOWS_BACK : sides == SHOWS_BACK;
    const intl shows = ((per_unit > 0.0f) & (intl)(sides & SHOWS_FRONT ? -1 : 0)) | ((per_unit < 0.0f) & (intl)(shows_back ? -1 : 0));
    const intl before = IS_BEFORE(map.dst_perspective, met);
    const intl settles = pixels->smooth & in_triangle & shows & !beside & !open & (w_met > 0.0f) & before;
    const intl own = hits_are == HITS_OF_PIXELS ? !pixels->smooth : (intl)0;
    pixels->n = pick(settles, met, pick(own, pixels->n, (floatl)EMPTY));
    pixels->traced = pixels->traced & !settles;
}

#define SORT(i, j)                                                                                             \
    {                                                                                                          \
        const floatl first = min_lanes(places[i], places[j]), last = max_lanes(places[i], places[j]);              \
        places[i] = first;                                                                                     \
        places[j] = last;                                                                                      \
    }
#define SORT_NINE                                                                                              \
    SORT(0, 3) SORT(1, 7) SORT(2, 5) SORT(4, 8) SORT(0, 7) SORT(2, 4) SORT(3, 8) SORT(5, 6) SORT(0, 2)         \
    SORT(1, 3) SORT(4, 5) SORT(7, 8) SORT(1, 4) SORT(3, 6) SORT(5, 7) SORT(0, 1) SORT(2, 4) SORT(3, 5)         \
    SORT(6, 8) SORT(2, 3) SORT(4, 5) SORT(6, 7) SORT(1, 2) SORT(3, 4) SORT(5, 6)
#define SORT_FIVE                                                                                              \
    SORT(0, 3) SORT(1, 4) SORT(0, 2) SORT(1, 3) SORT(0, 1) SORT(2, 4) SORT(1, 2) SORT(3, 4) SORT(2, 3)

/* Where on the pixels' own lines the answers lie that pixels x of row y got; INFINITY: nowhere. Beyond the image's border
 * the pixels at the border stand in. */
INLINED floatl place_of(global const float *hits, PixelMap map, Rays rays, Epipolar epipolar, intl x, int y)
{
    global const float *row = hits + (size_t)clamp(y, 0, map.dst_height - 1) * map.dst_pitch;
    const intl at = min(max(x, (intl)0), (intl)(map.dst_width - 1));
    const floatl hit = (floatl)(gather(row, at));
    const floatl place = distance_of(rays, epipolar, hit);
    return pick(IS_HIT(hit) & isfinite_lanes(place), place, (floatl)INFINITY);
}

/* Pixels of a row, one a lane, traced around what their line and their neighbours' lines saw. Target nearness of the
 * hits, BLOCKED or EMPTY. */
INLINED floatl trace_around(global const float *hits, Grid grid, PixelMap map, intl x, int y, intl wanted, int sides, int neighbour_offset,
                    float density, float window, uint *cells)
{
    const Rays rays = rays_of(map, to_floatl(x), y);
    const Epipolar epipolar = epipolar_of(rays, grid);
    floatl places[CANDIDATES];
    places[0] = place_of(hits, map, rays, epipolar, x, y);
    places[1] = place_of(hits, map, rays, epipolar, x - 1, y);
    places[2] = place_of(hits, map, rays, epipolar, x + 1, y);
    places[3] = place_of(hits, map, rays, epipolar, x, y - 1);
    places[4] = place_of(hits, map, rays, epipolar, x, y + 1);
    for (int i = 5; i < CANDIDATES; i++)
        places[i] = INFINITY;
    if (IS_ZOOMED) {
        places[5] = place_of(hits, map, rays, epipolar, x - neighbour_offset, y);
        places[6] = place_of(hits, map, rays, epipolar, x + neighbour_offset, y);
        places[7] = place_of(hits, map, rays, epipolar, x, y - neighbour_offset);
        places[8] = place_of(hits, map, rays, epipolar, x, y + neighbour_offset);
        SORT_NINE
    } else {
        SORT_FIVE
    }
    floatl found = EMPTY;
    intl active = wanted & (places[0] < INFINITY);
    for (int attempt = 0; attempt < 2; attempt++) {
        Windows windows;
        windows.radius = (attempt ? WIDE_WINDOW : window) * density;
        windows.from = places[0] - windows.radius;
        windows.to = places[0] + windows.radius;
        for (int i = 1; i < CANDIDATES; i++)
            windows.next[i - 1] = places[i];
        found = pick(active, trace(grid, rays, epipolar, windows, sides, active, cells), found);
        /* A stretch of a connected surface that begins behind it sees its back: once more, from farther off. */
        active = active & !IS_HIT(found) & (intl)(grid.cut.far_scale == 0.0f ? -1 : 0);
        if (!any_lane(active))
            break;
    }
    return found;
}

/* Samples, as numbers y * width + x, and what each counts: a triangle's corners, or the nearest sample as the first of them */
typedef struct {
    intl corner, beside, below;
    floatl at_corner, at_beside, at_below;
} Mixed;

/* What is seen where the pixels' rays meet the source; of nearest samples, the pixels get their nearness, too. */
INLINED Mixed samples_there(Pixels *pixels, Grid grid, PixelMap map, int linear)
{
    const float *D = map.dst_from_src;
    const int step_x = min(map.src_width - 1, 1), step_y = min(map.src_height - 1, 1); /* 0 in an image of one column */
    const floatl u = pixels->u, v = pixels->v;
    const floatl uc = truncated(clamp_lanes(u, (floatl)0.0f, (floatl)max(map.src_width - 2, 0)));
    const floatl vc = truncated(clamp_lanes(v, (floatl)0.0f, (floatl)max(map.src_height - 2, 0)));
    const floatl fu = clamp_lanes(u - uc, (floatl)0.0f, (floatl)1.0f);
    const floatl fv = clamp_lanes(v - vc, (floatl)0.0f, (floatl)1.0f);
    const intl cell_x = to_intl(uc), cell_y = to_intl(vc);
    if (!linear) {
        const intl sx = cell_x + pick(fu >= 0.5f, (intl)step_x, (intl)0);
        const intl sy = cell_y + pick(fv >= 0.5f, (intl)step_y, (intl)0);
        const intl at = sy * map.src_pitch + sx;
        const floatl q = (floatl)(gather(grid.nearness, at)), sample_u = to_floatl(sx), sample_v = to_floatl(sy);
        const floatl w = MAP_ROW(D, 2, sample_u, sample_v, q);
        pixels->n = pick(IS_HIT(pixels->n) & (w > 0.0f), MAP_ROW(D, 3, sample_u, sample_v, q) / w, pixels->n);
        const intl nearest = sy * map.src_width + sx;
        const Mixed one = {nearest, nearest, nearest, 1.0f, 0.0f, 0.0f};
        return one;
    }
    const floatl diagonal = fu + fv - 1.0f;
    const intl upper = diagonal > 0.0f;
    const intl cell = cell_y * map.src_width + cell_x, below = cell + step_y * map.src_width;
    const Mixed three = {pick(upper, below + step_x, cell), cell + step_x, below,
                         fabs(diagonal), pick(upper, 1.0f - fv, fu), pick(upper, 1.0f - fu, fv)};
    return three;
}

INLINED Color mixed_color(Mixed there, PixelMap map, global const channel *src_color, int linear)
{
    const int count = max(map.src_width * map.src_height, 2); /* there is room for two: `read_color` reads four bytes */
    const Color c0 = read_color(src_color, there.corner, count);
    if (!linear)
        return c0;
    const Color c1 = read_color(src_color, there.beside, count);
    Color c;
    c.r = there.at_corner * c0.r + there.at_beside * c1.r;
    c.g = there.at_corner * c0.g + there.at_beside * c1.g;
    c.b = there.at_corner * c0.b + there.at_beside * c1.b;
    if (any_lane(there.at_below != 0.0f)) { /* not on rows of samples */
        const Color c2 = read_color(src_color, there.below, count);
        c.r += there.at_below * c2.r;
        c.g += there.at_below * c2.g;
        c.b += there.at_below * c2.b;
    }
    return c;
}

/* Enters the `written` of the first `count` of LANES pixels, from number `first` of the picture on. */
INLINED void enter_pixels(GBuffer gbuffer, Mixed there, intl written, int count, size_t first, global const float *depth,
                          global const float *normals)
{
#if GBUFFER
    Color normal = {0.0f, 0.0f, 0.0f};
#if GBUFFER == 2
    const Vector a = vector_at(normals, there.corner), b = vector_at(normals, there.beside);
    const Vector c = vector_at(normals, there.below);
    normal.r = there.at_corner * a.x + there.at_beside * b.x + there.at_below * c.x;
    normal.g = there.at_corner * a.y + there.at_beside * b.y + there.at_below * c.y;
    normal.b = there.at_corner * a.z + there.at_beside * b.z + there.at_below * c.z;
#endif
    for (int lane = 0; lane < count; lane++)
        if (int_lane(written, lane))
            enter_pixel(gbuffer, first + lane, depth[first + lane], color_lane(normal, lane));
#endif
}

#if ORIGINS
/* Where the pixels come from, for the lanes of a mask */
INLINED void write_origins(Pixels pixels, intl written, int count, global float *origin, int view)
{
    for (int lane = 0; lane < count; lane++) {
        const float3 from = (float3)(float_lane(pixels.u, lane), float_lane(pixels.v, lane), view);
        if (int_lane(written, lane))
            vstore3(IS_HIT(float_lane(pixels.n, lane)) ? from : (float3)(NAN), lane, origin);
    }
}
#endif

/* The first `count` of LANES pixels; merge: only where they are nearer than what is there. Returns which are written. */
INLINED intl write_pixels(Pixels pixels, Color c, PixelMap map, int merge, int count, global float *depth, global channel *color,
                          global uchar *valid)
{
    const intl settled = IS_HIT(pixels.n);
    const floatl z = DEPTH_OF(map.dst_perspective, pixels.n);
    if (!merge && count == LANES) {
        store_lanes(pick(settled, z, (floatl)NAN), depth);
        store_bytes(to_ucharl(settled & 1), valid);
        const Color none = {0.0f, 0.0f, 0.0f};
        write_color(color, pick_color(settled, c, none));
        return (intl)-1;
    }
    intl written = 0;
    for (int lane = 0; lane < count; lane++) {
        const int is_settled = int_lane(settled, lane) != 0;
        const float z_new = float_lane(z, lane), z_old = merge ? depth[lane] : NAN;
        if (is_settled ? z_new >= z_old : merge)
            continue; /* what is there is nearer, or there is nothing to add */
        depth[lane] = is_settled ? z_new : NAN;
        valid[lane] = is_settled;
        set_int_lane(written, lane, -1);
        write_pixel(color + CHANNELS * lane, is_settled ? rounded_channel(color_lane(c, lane)) : (float3)(0.0f));
    }
    return written;
}

/* Where the pixels lie in the source, hardware does not foresee. */
void prefetch_place(Grid grid, global const channel *color, floatl u, floatl v)
{
#if LANES == 16
    const intl x = clamp(to_intl(u), (intl)0, (intl)(grid.width - 1)), y = clamp(to_intl(v), (intl)0, (intl)(grid.height - 1));
    const intl below = min(y + 1, grid.height - 1), samples = y * grid.pitch + x, samples_below = below * grid.pitch + x;
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

kernel void resolve(global const float *nearness, global const float *hits, global const channel *src_color,
                    global float *depth, global channel *color, global uchar *valid, PixelMap map, Cut cut, int sides,
                    int linear, int merge, int low_x, int high_x, int low_y, int high_y, int hits_are, float density,
                    int neighbour_offset, float typical, float rough, float window
#if ORIGINS
                    ,
                    global float *origin /* (dst_height, dst_width, 3): u, v and the number of the view */, int view
#endif
                    COUNTERS_PARAMETER(uint) GBUFFER_PARAMETERS NORMALS_PARAMETER(float))
{
    const int y = low_y + get_global_id(1);
    const int strip_x = low_x + get_global_id(0) * (STRIP * LANES);
    if (y >= high_y || strip_x >= high_x)
        return;
    const float *S = map.src_from_dst;
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
    const int packets = min(STRIP, (high_x - strip_x + LANES - 1) / LANES);
    Pixels pixels[STRIP];
    for (int p = 0; p < packets; p++) {
        const int x0 = strip_x + p * LANES;
        pixels[p] = read_hits(hits, map, x0, y, x0 + lane_index < high_x, hits_are, neighbour_offset, density, typical, rough);
        prefetch_place(grid, src_color, pixels[p].u, pixels[p].v);
    }
    for (int p = 0; p < packets; p++) {
        if (any_lane(pixels[p].smooth))
            intersect_at_hits(&pixels[p], grid, map, strip_x + p * LANES, y, hits_are, sides);
        else if (hits_are != HITS_OF_PIXELS)
            pixels[p].n = EMPTY;
    }

    /* Those that are not settled, in full packets. */
    int left[(STRIP + 1) * LANES], count = 0;
    if (hits_are == HITS_OF_LINES)
        for (int p = 0; p < packets; p++) {
            const intl traced = pixels[p].traced;
            if (any_lane(traced))
                for (int lane = 0; lane < LANES; lane++) {
                    left[count] = p * LANES + lane;
                    count += int_lane(traced, lane) != 0;
                }
        }
    uint cells = 0;
    for (int first = 0; first < count; first += LANES) {
        const intl wanted = first + lane_index < count;
        const intl pixel = pick(wanted, (intl)load_lanes(left + first), (intl)0), x = strip_x + pixel;
        const floatl n = trace_around(hits, grid, map, x, y, wanted, sides, neighbour_offset, density, window, &cells);
        for (int i = 0; i < min(count - first, LANES); i++)
            set_float_lane(pixels[left[first + i] / LANES].n, left[first + i] % LANES, float_lane(n, i));
    }

    for (int p = 0; p < packets; p++) {
        if (merge && !any_lane(IS_HIT(pixels[p].n)))
            continue;
        const int x0 = strip_x + p * LANES;
        const size_t out = (size_t)y * map.dst_width + x0;
        if (hits_are != HITS_OF_PIXELS)
            find_place(&pixels[p], map, x0, y);
        const Mixed there = samples_there(&pixels[p], grid, map, linear);
        const Color c = mixed_color(there, map, src_color, linear);
        pixels[p].n = pick(IS_BEFORE(map.dst_perspective, pixels[p].n), pixels[p].n, (floatl)EMPTY);
        const int in_packet = min(high_x - x0, LANES);
        const intl written = write_pixels(pixels[p], c, map, merge, in_packet, depth + out, color + CHANNELS * out, valid + out);
#if ORIGINS /* else nothing asks what is written */
        write_origins(pixels[p], written, in_packet, origin + 3 * out, view);
#endif
        const GBuffer gbuffer = GBUFFER_VALUE;
        enter_pixels(gbuffer, there, written, in_packet, out, depth, NORMALS_ARGUMENT(float));
    }
#if COUNTERS
    const int across = (high_x - low_x + STRIP * LANES - 1) / (STRIP * LANES);
    const int item = get_global_id(1) * across + get_global_id(0);
    counters[2 * item] = cells * LANES;
    counters[2 * item + 1] = count;
#endif
}
