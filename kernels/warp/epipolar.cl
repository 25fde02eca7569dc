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
 * seen: (dst_height, dst_pitch) answers (answers.h), filled with EMPTY before; behind them LANES
 * floats a work-item, for lanes with nothing to write. ALIGNED: all lines run along rows or columns of both images
 * (stereo, light fields) and pass through the pixels' centres, so that their answers are the pixels' own.
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

INLINED Place pick_place(intl mask, Place yes, Place no)
{
    Place place;
    place.nearness = pick(mask, yes.nearness, no.nearness);
    place.p = pick(mask, yes.p, no.p);
    place.w = pick(mask, yes.w, no.w);
    place.q = pick(mask, yes.q, no.q);
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
/* Where a line passes a column (a row) of the source, between two of its samples. */
typedef struct {
    floatl cell, part; /* the first sample, and the share of the way to the second */
    intl at;           /* the first sample's index */
    floatl a, b;       /* their nearness */
    Place place;
} Column;

#define IS_TRIANGLE_OPEN(cut, a, b, c) IS_OPEN(cut, greater(a, greater(b, c)), lesser(a, lesser(b, c)))

/* Between two columns where the surface may be torn: as far as there are triangles. The line passes two of them in the
 * cell that it is in, or up to four where it passes a row, whose other samples are beyond_from and beyond_to. Cells are
 * seen so that the line goes towards larger columns and their diagonals from `from.b` to `to.a`. */
INLINED void extend_torn(Interval *interval, Answers *answers, Cut cut, Targets targets, floatl major, Column from, Column to,
                         floatl begins, floatl ends, floatl passed, floatl slope, floatl beyond_from, floatl beyond_to,
                         intl active, Epipolars line, LineGroup group, PixelMap map)
{
    const intl down = passed > 0.0f, up = passed < 0.0f;
    /* The cell that the line comes from, in the second column, and the cell that it goes to, in the first. */
    const floatl to_a = pick(down, beyond_to, pick(up, to.b, to.a)), to_b = pick(down, to.a, pick(up, beyond_to, to.b));
    const floatl from_a = pick(down, from.b, pick(up, beyond_from, from.a)), from_b = pick(down, beyond_from, pick(up, from.a, from.b));
    /* Where it leaves the triangles, as a share of the way, and the surface's nearness there. */
    const floatl per_diagonal = 1.0f / (1.0f + slope), first = (1.0f - from.part) * per_diagonal;
    const floatl row = lesser(pick(down, 1.0f - from.part, -from.part) / slope, (floatl)1.0f);
    floatl leaves[4], nearness[4];
    intl open[4];
    leaves[0] = lesser(first, pick(passed == 0.0f, (floatl)1.0f, row));
    leaves[1] = pick(passed == 0.0f, leaves[0], row);
    leaves[2] = pick(down, greater(lesser((2.0f - from.part) * per_diagonal, (floatl)1.0f), row), leaves[1]);
    leaves[3] = 1.0f;
    nearness[1] = pick(down, from.b, from.a) + leaves[1] * (pick(down, to.a, to.b) - pick(down, from.b, from.a));
    nearness[0] = pick((passed == 0.0f) | (first < row), from.b + leaves[0] * (to_a - from.b), nearness[1]);
    nearness[2] = from_b + leaves[2] * (to.a - from_b);
    nearness[3] = 0.0f;
    open[0] = IS_TRIANGLE_OPEN(cut, from.a, from.b, to_a);
    open[1] = IS_TRIANGLE_OPEN(cut, to_a, to_b, from.b);
    open[2] = IS_TRIANGLE_OPEN(cut, from_a, from_b, to.a);
    open[3] = IS_TRIANGLE_OPEN(cut, to.a, to.b, from_b);

    Place begin = from.place, enters = from.place;
    floatl at = begins;
    intl inside = 0;
    for (int part = 0; part <= 4; part++) {
        intl there = 0, stops = active;
        Place left = to.place;
        if (part < 4) {
            there = active & (leaves[part] > at) & (at < ends);
            left = pick_place(leaves[part] < ends, place_at(targets, major + line.sign * leaves[part], nearness[part]), to.place);
            stops = there & (open[part] | IS_BEHIND(map, enters) | IS_BEHIND(map, left));
        }
        if (any_lane(inside & stops))
            extend(interval, answers, begin, enters, inside & stops, (intl)0, line, group, map);
        if (part == 4)
            break;
        interval->anew = interval->anew | stops;
        begin = pick_place(inside, begin, enters);
        inside = (inside | there) & !stops;
        enters = pick_place(there, left, enters);
        at = pick(there, leaves[part], at);
    }
}

/* From column to column (or row to row). Returns the steps. */
INLINED uint walk_samples(Grid grid, Epipolars line, LineGroup group, PixelMap map, Answers *answers)
{
    const floatl low = floor_lanes(line.from), high = lesser(ceil_lanes(line.to), line.last_major);
    const intl steps = pick((line.low <= line.high) & (line.from <= line.to), to_intl(high - low), (intl)-1);
    const Targets targets =
        targets_of(map, line.along, pick(line.u_major, (floatl)0.0f, line.minor_0), pick(line.u_major, line.minor_0, (floatl)0.0f),
                   pick(line.u_major, (floatl)1.0f, line.tilt), pick(line.u_major, line.tilt, (floatl)1.0f));
    /* Mirrored where steps are towards smaller columns, so that all lines meet the cells' diagonals alike. */
    const intl mirrored = line.sign < 0.0f;
    const floatl last_minor = to_floatl(line.last_minor);
    const floatl minor_0 = pick(mirrored, last_minor - line.minor_0, line.minor_0), tilt = pick(mirrored, -line.tilt, line.tilt);
    const floatl slope = tilt * line.sign;
    const intl stride_minor = pick(mirrored, -line.stride_minor, line.stride_minor);
    const intl at_0 = pick(mirrored, line.last_minor * line.stride_minor, (intl)0);
    /* Lines along samples see the edges between them alone. */
    const floatl length = greater(high - low, (floatl)1.0f), start = minor_0 + tilt * low;
    const intl along = (fabs(start - floor_lanes(start + 0.5f)) < ON_SAMPLES) &
                       ((fabs(slope) * length < ON_SAMPLES) | (fabs(slope + 1.0f) * length < ON_SAMPLES));
    const intl to_second = pick(along | (line.last_minor == 0), (intl)0, stride_minor);
    const floatl nudge = pick(along, (floatl)0.5f, (floatl)0.0f);
    const intl last_cell = pick(along, line.last_minor, max(line.last_minor - 1, 0));

    Interval interval = nothing_settled(line);
    floatl major = pick(mirrored, high, low);
    const floatl begins = pick(mirrored, high - line.to, line.from - low); /* shares of the first step and the last */
    const floatl ends = 1.0f - pick(mirrored, line.from - low, high - line.to);
    Column from;
    from.cell = from.part = 0.0f;
    from.at = 0;
    from.a = from.b = NO_SURFACE;
    from.place = place_at(targets, major, (floatl)NO_SURFACE);
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
        const floatl minor = minor_0 + tilt * major;
        Column to;
        to.cell = to_floatl(max(min(to_intl(minor + nudge), last_cell), (intl)0));
        if (step) /* rounding must not pass two rows at once */
            to.cell = lesser(greater(to.cell, from.cell - 1.0f), from.cell + 1.0f);
        to.part = pick(along, (floatl)0.0f, minor - to.cell);
        to.at = at_0 + m * line.stride_major + to_intl(to.cell) * stride_minor;
#if LANES == 16
        FORESEE(grid.nearness, to.at, ahead, last_sample)
#endif
        const intl second = to.at + to_second;
        to.a = (floatl)(gather(grid.nearness, to.at));
        to.b = (floatl)(gather(grid.nearness, second));
        const floatl part = lesser(greater(to.part, (floatl)0.0f), (floatl)1.0f);
        to.place = place_at(targets, major, to.a + part * (to.b - to.a));
        const floatl passed = pick(along | (intl)(step ? 0 : -1), (floatl)0.0f, to.cell - from.cell);
        floatl beyond_from = from.a, beyond_to = to.a;
        if (any_lane(passed != 0.0f)) {
            const intl down = passed > 0.0f;
            const intl at_from = from.at + pick(down, 2 * stride_minor, pick(passed < 0.0f, -stride_minor, (intl)0));
            const intl at_to = to.at + pick(down, -stride_minor, pick(passed < 0.0f, 2 * stride_minor, (intl)0));
            beyond_from = (floatl)(gather(grid.nearness, at_from));
            beyond_to = (floatl)(gather(grid.nearness, at_to));
        }
        const floatl high = greater(greater(greater(from.a, from.b), greater(to.a, to.b)), greater(beyond_from, beyond_to));
        const floatl low = lesser(lesser(lesser(from.a, from.b), lesser(to.a, to.b)), lesser(beyond_from, beyond_to));
        floatl begins_at = 0.0f, ends_at = 1.0f;
        const intl is_last = step == steps;
        if (step == 1 || any_lane(is_last)) { /* lines end at the image's border and at the epipole, between columns */
            const floatl nearness = from.place.nearness, change = to.place.nearness - nearness;
            begins_at = step == 1 ? begins : begins_at;
            ends_at = pick(is_last, ends, ends_at);
            if (step == 1)
                from.place = place_at(targets, major + line.sign * (begins - 1.0f), nearness + begins * change);
            to.place = pick_place(is_last, place_at(targets, major + line.sign * (ends_at - 1.0f), nearness + ends_at * change), to.place);
        }
        const intl torn = active & (IS_OPEN(grid.cut, high, low) | IS_BEHIND(map, from.place) | IS_BEHIND(map, to.place));
        if (any_lane(torn))
            extend_torn(&interval, answers, grid.cut, targets, major - line.sign, from, to, begins_at, ends_at, passed, slope, beyond_from,
                        beyond_to, active, line, group, map);
        else
            extend(&interval, answers, from.place, to.place, active, (intl)0, line, group, map);
        from = to;
    }
    return samples;
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
