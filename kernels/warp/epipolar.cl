/* The epipolar sweep: the O(n^2) inverse warp (Schaufler & Priglinger 1999, sections 4 and 5).
 *
 * Epipolar planes cut both images in lines. Along a source line, walked from the epipole outwards (its antipode
 * inwards), samples come in the order in which a ray of the target passes them, so the first segment that crosses a
 * ray is what that ray sees. The pixels that a connected run of samples has settled are one interval of the target
 * line, and a step of the walk extends it at either end: steps add up to samples plus pixels, not to their product.
 *
 * Signs stand in the homogeneous epipoles b (target) and e (source), so that epipole, antipode, infinity and all
 * four walking orders are one case: with D = pixel * w - (u, v), the source is walked along +D, and the target's
 * pixels meet the front of the surface along -D.
 *
 * Deviations from the paper: lines are laid where needed, one per pixel of the farthest column (or row) and every
 * second one at each halving of the distance to the epipole, instead of one per border pixel; a pixel belongs to
 * the nearest line by arithmetic, not by a flag; the order of writing needs no depth test even where the surface is
 * cut. The result is the nearness of what the line's ray sees: resolve.cl finds the pixel's own ray's hit from it.
 *
 * Work-item: LANES lines of one group. Cost: source samples + target pixels a line; lines <= about 2 (width + height).
 * Determinism: a pixel is written by at most one lane.
 *
 * seen: (dst_height, dst_pitch) answers (answers.h), filled with EMPTY before unless ALIGNED; behind them LANES
 * floats a work-item, for lanes with nothing to write. ALIGNED: all lines run along rows or columns of both images
 * (stereo, light fields) and pass through the pixels' centres, so that their answers are the pixels' own. There is a
 * line for each row (or column), the first packet begins with the first one, and each packet fills its own with EMPTY.
 * EDGES: the surface is followed from edge to edge of its triangles, and not from column to column (row to row) alone,
 * which skips their diagonals: exact for the line, at about twice the cost.
 */
#include "warp/answers.h"
#include "warp/lines.h"

#define AHEAD 8 /* steps between a prefetch and the use */
/* Walks across rows touch a new page each step, which hardware does not foresee. Lines next to each other share
 * cache lines: the first and the last are enough. */
#define FORESEE_LANE(l) foresee(base + fetched.s##l);
#define FORESEE(array, index, by, last)                                                                        \
    {                                                                                                          \
        global const float *base = array;                                                                      \
        const intl fetched = clamp(index + by, (intl)0, (intl)(last));                                         \
        FORESEE_LANE(0) FORESEE_LANE(f)                                                                        \
        if (group.spacing > 1.0f) {                                                                            \
            FORESEE_LANE(8)                                                                                    \
            if (group.spacing > 2.0f) {                                                                        \
                FORESEE_LANE(4) FORESEE_LANE(c)                                                                \
            }                                                                                                  \
        }                                                                                                      \
    }

/* The interval that a connected run of samples has settled, [below + 1, above - 1]. */
typedef struct {
    floatl below, above;
    intl anew;  /* the next segment begins another interval */
    intl begun; /* there has been one */
} Interval;

/* A sample (or a place between samples) of the line: its nearness, and its homogeneous target position. */
typedef struct {
    floatl nearness, p, w, q;
} Place;

/* Where a line's answers go. */
typedef struct {
    global float *seen;
    int spare;      /* for lanes with nothing to write */
    int up_hides, down_hides; /* 1: segments that extend the interval that way have a side that is not shown */
    int begun_anew; /* a lane has more than one interval: pixels outside of the last one may be settled, too */
    uint pixels;
} Answers;

#define COUNT(counter, mask) for (int l = 0; l < LANES; l++) counter += ((int *)&(mask))[l] != 0;
#define STORE_LANE(l) seen[address.s##l] = stored.s##l;

/* Settles the pixels between the ends of a segment of the surface that its interval does not hold yet. there: lanes
 * that have a segment; open: it is no surface. */
INLINED void extend(Interval *interval, Answers *answers, Place a, Place b, intl there, intl open, Epipolars line, LineGroup group, PixelMap map)
{
    const float guard = 5e-7f * (map.dst_width + map.dst_height); /* rounding: no pixel may have two owners, */
    global float *seen = answers->seen;

    const floatl crosses = b.p * a.w - a.p * b.w; /* the sign of the target's move from a to b, if both are before it */
    const intl emerges = (a.w <= 0.0f) & (b.w > 0.0f); /* out of the plane of the target's centre */
    const intl begins = there & (!open) & (interval->anew | emerges);
    if (any_lane(begins)) {
        const floatl from_infinity = pick(crosses > 0.0f, (floatl)-1e9f, (floatl)1e9f);
        const floatl t = lesser(greater(pick(emerges, from_infinity, a.p / a.w), line.low - 1.0f), line.high + 1.0f);
        /* and a pixel that the segment only just begins at is its own, whichever way it goes on */
        const floatl next = pick((crosses > 0.0f) | emerges, ceil_lanes(t - guard), floor_lanes(t + guard) + 1.0f);
        const floatl first = lesser(greater(next, line.low), line.high + 1.0f);
        interval->above = pick(begins, first, interval->above);
        interval->below = pick(begins, first - 1.0f, interval->below);
        answers->begun_anew |= any_lane(begins & interval->begun);
        interval->begun = interval->begun | begins;
    }
    interval->anew = pick(there, open, interval->anew);
    const intl closed = there & !open;
    for (;;) {
        const intl goes_up = closed & (b.p - interval->above * b.w >= -guard * b.w) & (interval->above <= line.high);
        const intl goes_down = closed & (b.p - interval->below * b.w <= guard * b.w) & (interval->below >= line.low);
        if (!any_lane(goes_up | goes_down))
            break;
        const floatl p = pick(goes_up, interval->above, interval->below);
        const floatl g0 = a.p - p * a.w, g1 = b.p - p * b.w;
        const floatl f = lesser(greater(g0 / (g0 - g1), (floatl)0.0f), (floatl)1.0f);
        const floatl w = a.w + f * (b.w - a.w);
        const intl settles = (goes_up | goes_down) & (w > 0.0f);
        if (!any_lane(settles))
            break;
#ifdef COUNT_SAMPLES
        COUNT(answers->pixels, settles)
#endif
        interval->above = pick(settles & goes_up, interval->above + 1.0f, interval->above);
        interval->below = pick(settles & !goes_up, interval->below - 1.0f, interval->below);

#if ALIGNED /* each line has pixels of its own */
        const intl address = pick(settles, line.first_pixel + to_intl(p) * (line.along ? map.dst_pitch : 1), answers->spare + lane_index);
#else
        const float b_along = map.dst_from_src[4 * line.along + 3], b_across = map.dst_from_src[4 * line.across + 3];
        const float b_w = map.dst_from_src[11], innermost = 1 << group.levels;
        const floatl at_line = line.start + line.slope * p, c = floor_lanes(at_line + 0.5f);
        const floatl distance = group.distance + group.distance_step * p;
        /* Lines are 1/2 to 1 pixel apart in each ring, less within the last one. */
        const floatl in_ring = as_floatl(((as_intl(distance) - 1) & 0x007fffff) | 0x3f000000);
        const floatl apart = lesser(in_ring, distance * innermost);
        const floatl D_along = (p * b_w - b_along) * group.side, D_across = fabs(c * b_w - b_across);
        const intl in_wedge = line.along ? (D_along > D_across) : (D_along >= D_across);
        const intl owns = in_wedge & (fabs(at_line - c) < 0.5f * apart - guard) & (distance > group.least) &
                          (c >= group.cross_low) & (c <= group.cross_high);
        const intl pc = to_intl(c), pa = to_intl(p);
        const intl address = pick(settles & owns, line.along ? pa * map.dst_pitch + pc : pc * map.dst_pitch + pa,
                                  answers->spare + lane_index);
#endif
#if LANES == 16
        if (line.along) {
            const int ahead = AHEAD * map.dst_pitch;
            FORESEE(seen, address, pick(goes_up, (intl)ahead, (intl)-ahead), map.dst_height * map.dst_pitch - 1)
        }
#endif
        const floatl met = (a.q + f * (b.q - a.q)) / w;
        const intl hides = pick(goes_up, (intl)answers->up_hides, (intl)answers->down_hides);
        const floatl value = ANSWER(met, hides);
        floatl stored = value;
        if (answers->begun_anew) {
            const floatl before = (floatl)(gather(seen, address));
            stored = pick(before == EMPTY, value, before);
        }
#if LANES == 1
        seen[address] = stored;
#else
        EACH_LANE(STORE_LANE)
#endif
    }
}

/* Homogeneous target positions along lines of the source at nearness 0: affine in the distance walked. */
typedef struct {
    floatl p_0, p_1, w_0, w_1, q_0, q_1;
    float b_p, b_w, b_q; /* and what nearness adds */
} Targets;

INLINED Targets targets_of(PixelMap map, int along, floatl u, floatl v, floatl du, floatl dv)
{
    const float *D = map.dst_from_src;
    Targets targets;
    targets.p_0 = PIXEL_ROW(D, along, u, v);
    targets.p_1 = D[4 * along] * du + D[4 * along + 1] * dv;
    targets.w_0 = PIXEL_ROW(D, 2, u, v);
    targets.w_1 = D[8] * du + D[9] * dv;
    targets.q_0 = PIXEL_ROW(D, 3, u, v);
    targets.q_1 = D[12] * du + D[13] * dv;
    targets.b_p = D[4 * along + 3];
    targets.b_w = D[11];
    targets.b_q = D[15];
    return targets;
}

INLINED Place place_at(Targets targets, floatl distance, floatl nearness)
{
    Place place;
    place.nearness = nearness;
    place.p = targets.p_0 + targets.p_1 * distance + nearness * targets.b_p;
    place.w = targets.w_0 + targets.w_1 * distance + nearness * targets.b_w;
    place.q = targets.q_0 + targets.q_1 * distance + nearness * targets.b_q;
    return place;
}

/* Behind an orthographic target's image plane? Behind a perspective one, W tells. */
#define IS_BEHIND(map, place) ((map).dst_perspective ? (intl)0 : ((place).q >= 0.0f))

INLINED Interval nothing_settled(Epipolars line)
{
    Interval interval;
    interval.anew = -1;
    interval.begun = 0;
    interval.above = line.low;
    interval.below = line.low - 1.0f;
    return interval;
}

#if EDGES
/* Along the edges of the triangles. Returns the cells that were passed. */
INLINED uint walk_edges(Grid grid, Epipolars line, LineGroup group, PixelMap map, Answers *answers)
{
    const floatl from = pick(line.sign > 0.0f, line.from, line.to), minor = line.minor_0 + line.tilt * from;
    Lines lines;
    lines.u = pick(line.u_major, from, minor);
    lines.v = pick(line.u_major, minor, from);
    lines.du = line.sign * pick(line.u_major, (floatl)1.0f, line.tilt);
    lines.dv = line.sign * pick(line.u_major, line.tilt, (floatl)1.0f);
    lines.length = pick(line.low <= line.high, line.to - line.from, (floatl)-1.0f);
    snap(&lines);
    const Way way = way_of(lines, grid);
    const Targets targets = targets_of(map, line.along, lines.u, lines.v, lines.du, lines.dv);
    Interval interval = nothing_settled(line);
    floatl at = 0.0f, x = 0.0f, y = 0.0f;
    intl active = lines.length > 0.0f, connected = 0;
    enter_cells(lines, at, active, &x, &y);
    Place before = place_at(targets, at, (floatl)NO_SURFACE);
    uint cells = 0;
    while (any_lane(active)) {
#ifdef COUNT_SAMPLES
        COUNT(cells, active)
#endif
        const Cell cell = pass_cells(grid, lines, way, x, y, at);
        Place enters = place_at(targets, at, cell.q_in);
        enters.p = pick(connected, before.p, enters.p);
        enters.w = pick(connected, before.w, enters.w);
        enters.q = pick(connected, before.q, enters.q);
        const Place crosses = place_at(targets, cell.crossing, cell.q_crossing), leaves = place_at(targets, cell.out, cell.q_out);
        const intl has_both = cell.has_first & cell.has_second;
        for (int part = 0; part < 2; part++) {
            const intl there = active & (part ? cell.has_second : cell.has_first);
            if (!any_lane(there))
                continue;
            Place a = enters, b = leaves;
            if (part) {
                a.p = pick(has_both, crosses.p, enters.p);
                a.w = pick(has_both, crosses.w, enters.w);
                a.q = pick(has_both, crosses.q, enters.q);
            } else {
                b.p = pick(has_both, crosses.p, leaves.p);
                b.w = pick(has_both, crosses.w, leaves.w);
                b.q = pick(has_both, crosses.q, leaves.q);
            }
            const intl open = (part ? cell.second_open : cell.first_open) | IS_BEHIND(map, a) | IS_BEHIND(map, b);
            extend(&interval, answers, a, b, there, open, line, group, map);
        }
        connected = pick(cell.has_second, !cell.second_open, pick(cell.has_first, !cell.first_open, connected));
        before = leaves;
        x = cell.next_x;
        y = cell.next_y;
        at = cell.out;
        active = active & (at < lines.length);
    }
    return cells;
}
#else
/* From column to column (or row to row): where the line passes between two samples. Returns the steps. */
INLINED uint walk_samples(Grid grid, Epipolars line, LineGroup group, PixelMap map, Answers *answers)
{
    const intl steps = pick((line.low <= line.high) & (line.from <= line.to), to_intl(line.to - line.from), (intl)-1);
    const Targets targets =
        targets_of(map, line.along, pick(line.u_major, (floatl)0.0f, line.minor_0), pick(line.u_major, line.minor_0, (floatl)0.0f),
                   pick(line.u_major, (floatl)1.0f, line.tilt), pick(line.u_major, line.tilt, (floatl)1.0f));
    Interval interval = nothing_settled(line);
    floatl major = pick(line.sign > 0.0f, line.from, line.to);
    Place before = place_at(targets, major, (floatl)NO_SURFACE);
    uint samples = 0;
#if LANES == 16
    const int last_sample = map.src_height * map.src_pitch - 1;
    const intl ahead = AHEAD * to_intl(line.sign) * line.stride_major;
#endif
    for (int step = 0; any_lane(step <= steps); step++, major += line.sign) {
        const intl active = step <= steps;
#ifdef COUNT_SAMPLES
        COUNT(samples, active)
#endif
        const intl m = clamp(to_intl(major), (intl)0, to_intl(line.last_major));
        const floatl minor = lesser(greater(line.minor_0 + line.tilt * major, (floatl)0.0f), to_floatl(line.last_minor));
        const intl cell = max(min(to_intl(minor), line.last_minor - 1), (intl)0);
        const floatl part = minor - to_floatl(cell);
        const intl at = m * line.stride_major + cell * line.stride_minor;
#if LANES == 16
        FORESEE(grid.nearness, at, ahead, last_sample)
#endif
        const intl next = at + pick(line.last_minor > 0, line.stride_minor, (intl)0);
        const floatl qa = (floatl)(gather(grid.nearness, at)), qb = (floatl)(gather(grid.nearness, next));
        const intl torn = IS_OPEN(grid.cut, greater(qa, qb), lesser(qa, qb));
        const Place here = place_at(targets, major, pick(torn, pick(part < 0.5f, qa, qb), qa + part * (qb - qa)));
        const floatl high = greater(here.nearness, before.nearness), low = lesser(here.nearness, before.nearness);
        const intl open = IS_OPEN(grid.cut, high, low) | IS_BEHIND(map, before) | IS_BEHIND(map, here);
        extend(&interval, answers, before, here, active, open, line, group, map);
        before = here;
    }
    return samples;
}
#endif

#if ALIGNED
/* Nothing is settled on the rows (or columns) of a packet, whose first is the given one. */
INLINED void clear_lines(global float *seen, int first, int along, PixelMap map)
{
    const int rows = along ? map.dst_height : min(LANES, map.dst_height - first), columns = along ? 1 : map.dst_width;
    global float *from = seen + (along ? first : (size_t)first * map.dst_pitch);
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x += LANES) /* rows have room for whole packets */
            store_lanes((floatl)EMPTY, from + (size_t)y * map.dst_pitch + x);
}
#endif

kernel void epipolar_sweep(global const float *nearness, global float *seen, global const LineGroup *groups,
                           int group_count, int packet_count, PixelMap map, Cut cut, int shown, float nearest,
                           float farthest
#ifdef COUNT_SAMPLES
                           ,
                           global uint *counts /* (packet_count, 2): samples and pixels visited */
#endif
)
{
    const int id = get_global_id(0);
    if (id >= packet_count)
        return;
    /* Runtimes give a thread neighbours; lines next to each other take equally long. So each thread gets all kinds. */
    const int half_ = (packet_count + 1) / 2;
    const int packet = id < half_ ? 2 * id : 2 * (id - half_) + 1;
    int g = 0;
    while (g + 1 < group_count && packet >= groups[g + 1].first_packet)
        g++;
    const LineGroup group = groups[g];
    const Epipolars line = epipolars_of(group, map, packet, nearest, farthest);
#if ALIGNED
    clear_lines(seen, packet * LANES, line.along, map);
#endif
    if (!any_lane((line.low <= line.high) & (line.from <= line.to)))
        return;
    const int front_is_up = group.side < 0; /* -D is towards larger pixels */
    Answers answers;
    answers.seen = seen;
    answers.spare = map.dst_height * map.dst_pitch + packet * LANES;
    answers.up_hides = !(shown & (front_is_up ? SHOWS_FRONT : SHOWS_BACK));
    answers.down_hides = !(shown & (front_is_up ? SHOWS_BACK : SHOWS_FRONT));
    answers.begun_anew = 0;
    answers.pixels = 0;
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
#if EDGES
    const uint samples = walk_edges(grid, line, group, map, &answers);
#else
    const uint samples = walk_samples(grid, line, group, map, &answers);
#endif
#ifdef COUNT_SAMPLES
    counts[2 * packet] = samples;
    counts[2 * packet + 1] = answers.pixels;
#endif
}
