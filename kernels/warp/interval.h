#ifndef WARP_INTERVAL_H
#define WARP_INTERVAL_H
/* Intervals of settled pixels. A walk along a line of the source settles the pixels of the target's line: each gets the
 * hit on the first segment (between two samples) that crosses its ray, and keeps it. A connected run of samples settles
 * one interval of pixels; each segment of the run extends the interval at one end.
 */
#include "warp/hits.h"
#include "warp/lines.h"

#define PREFETCH_STEPS 8 /* number of steps by which data are prefetched before their use */

/* Prefetches for lines across rows, which read from another page of memory at each step. Neighbouring lines share cache
 * lines, so it is enough to prefetch for the first and the last lane, and sometimes for a few others. */
INLINED void prefetch_across_rows(global const float *array, intl index, LineGroup group)
{
#if LANES == 16
    prefetch_at(array + index.s0);
    prefetch_at(array + index.sf);
    if (group.spacing > 1.0f)
        prefetch_at(array + index.s8);
    if (group.spacing > 2.0f) {
        prefetch_at(array + index.s4);
        prefetch_at(array + index.sc);
    }
#endif
}

/* An interval of a line's settled pixels: those after `below` and before `above` */
typedef struct {
    floatl below, above;
    intl ended; /* mask: the run of samples has ended, and the next segment begins another interval */
    intl begun; /* mask: the line has an interval */
    floatl first, last; /* a range that contains all pixels of the line's earlier intervals */
} Interval;

/* A sample of the line, or a place between samples: its source nearness, and its homogeneous target position (p: along
 * the line). */
typedef struct {
    floatl nearness, p, w, q;
} Projection;

/* State for writing the hits of lines */
typedef struct {
    global float *hits;
    int spare;      /* index in `hits` at which lanes without a pixel write */
    int up_hides;   /* 1: a segment that extends the interval to larger pixels shows a side that is not drawn */
    int down_hides; /* 1: the same for a segment that extends the interval to smaller pixels */
    uint pixels;
} HitWriter;

INLINED Projection select_projection(intl mask, Projection yes, Projection no)
{
    Projection place;
    place.nearness = select_lanes(mask, yes.nearness, no.nearness);
    place.p = select_lanes(mask, yes.p, no.p);
    place.w = select_lanes(mask, yes.w, no.w);
    place.q = select_lanes(mask, yes.q, no.q);
    return place;
}

/* Clips a segment to the part in front of an orthographic target's image plane. Sets `open` if the whole segment is
 * behind the plane. Returns the mask of segments that begin behind it. (For perspective targets, the sign of W is
 * enough.) */
INLINED intl clip_at_plane(Projection *a, Projection *b, intl *open)
{
    const intl a_behind = a->q >= 0.0f, b_behind = b->q >= 0.0f;
    const floatl f = a->q / (a->q - b->q);
    const Projection at = {a->nearness + f * (b->nearness - a->nearness), a->p + f * (b->p - a->p),
                           a->w + f * (b->w - a->w), (floatl)0.0f};
    const Projection from = select_projection(a_behind & !b_behind, at, *a);
    *b = select_projection(b_behind & !a_behind, at, *b);
    *a = from;
    *open = *open | (a_behind & b_behind);
    return a_behind;
}

#define STORE_LANE(l) hits[address.s##l] = stored.s##l;

/* The indices in `hits` of pixel p of each line. Lanes that are not `wanted`, or whose pixel belongs to another line,
 * get a spare index. */
INLINED intl owned_pixel(SweepLines line, LineGroup group, PixelMap map, floatl p, intl wanted, int spare, float guard)
{
#if ALIGNED /* no pixel belongs to two lines */
    return select_lanes(wanted, line.first_pixel + to_intl(p) * (line.along ? map.dst_pitch : 1),
                                      spare + lane_index);
#else
    const float b_along = AXIS_ENTRY(map.dst_from_src, line.along, 3);
    const float b_across = AXIS_ENTRY(map.dst_from_src, line.across, 3);
    const float b_w = map.dst_from_src[11], innermost = 1 << group.levels;
    const floatl at_line = line.start + line.slope * p, c = floor_lanes(at_line + 0.5f);
    const floatl distance = group.distance + group.distance_step * p;
    /* Where the distance to the epipole halves, every second line ends: so lines are 1/2 to 1 pixel apart; after the
     * last halving, less. */
    const floatl in_ring = as_floatl(((as_intl(distance) - 1) & 0x007fffff) | 0x3f000000);
    const floatl line_spacing = min_lanes(in_ring, distance * innermost);
    const floatl D_along = (p * b_w - b_along) * group.side, D_across = fabs(c * b_w - b_across);
    const intl in_wedge = line.along ? (D_along > D_across) : (D_along >= D_across);
    const intl owns = in_wedge & (fabs(at_line - c) < 0.5f * line_spacing - guard) & (distance > group.least) &
                      (c >= group.cross_low) & (c <= group.cross_high);
    const intl pc = to_intl(c), pa = to_intl(p);
    return select_lanes(
        wanted & owns, line.along ? pa * map.dst_pitch + pc : pc * map.dst_pitch + pa, spare + lane_index);
#endif
}

/* Settles the pixels between a segment's ends a and b, unless the interval contains them. there: mask of lanes that
 * have a segment; open: mask of segments without surface */
INLINED void extend(Interval *interval, HitWriter *writer, Projection a, Projection b, intl there, intl open,
                    SweepLines line, LineGroup group, PixelMap map)
{
    /* A tolerance for rounding, in pixels: no pixel may belong to two lines, and a segment that begins exactly at a
     * pixel must settle it, in whichever direction the segment goes on. */
    const float guard = 5e-7f * (map.dst_width + map.dst_height);
    global float *hits = writer->hits;

    intl from_behind = 0;
    if (!map.dst_perspective)
        from_behind = clip_at_plane(&a, &b, &open);
    const floatl crosses = b.p * a.w - a.p * b.w; /* > 0: from a to b, pixels increase, if both ends lie in front */
    const intl emerges = (a.w <= 0.0f) & (b.w > 0.0f); /* mask: only b lies in front of the target's centre */
    const intl begins = there & (!open) & (interval->ended | emerges | from_behind);
    if (any_lane(begins)) {
        const floatl from_infinity = select_lanes(crosses > 0.0f, (floatl)-1e9f, (floatl)1e9f);
        const floatl t = clamp_lanes(select_lanes(emerges, from_infinity, a.p / a.w), line.low - 1.0f,
                                     line.high + 1.0f);
        const floatl next = select_lanes((crosses > 0.0f) | emerges, ceil_lanes(t - guard),
                                         floor_lanes(t + guard) + 1.0f);
        const floatl first = clamp_lanes(next, line.low, line.high + 1.0f);
        const intl again = begins & interval->begun;
        interval->first = select_lanes(again, min_lanes(interval->below + 1.0f, interval->first), interval->first);
        interval->last = select_lanes(again, max_lanes(interval->above - 1.0f, interval->last), interval->last);
        interval->above = select_lanes(begins, first, interval->above);
        interval->below = select_lanes(begins, first - 1.0f, interval->below);
        interval->begun = interval->begun | begins;
    }
    interval->ended = select_lanes(there, open, interval->ended);
    const intl closed = there & !open;
    for (int pixels_left = group.high - group.low + 2; pixels_left > 0; pixels_left--) {
        const intl goes_up = closed & (b.p - interval->above * b.w >= -guard * b.w) & (interval->above <= line.high);
        const intl goes_down = closed & (b.p - interval->below * b.w <= guard * b.w) & (interval->below >= line.low);
        if (!any_lane(goes_up | goes_down))
            break;
        const floatl p = select_lanes(goes_up, interval->above, interval->below);
        const floatl g0 = a.p - p * a.w, g1 = b.p - p * b.w;
        const floatl f = clamp_lanes(g0 / (g0 - g1), (floatl)0.0f, (floatl)1.0f);
        const floatl w = a.w + f * (b.w - a.w);
        const intl settles = (goes_up | goes_down) & (w > 0.0f);
        if (!any_lane(settles))
            break;
        COUNT(writer->pixels, settles)
        interval->above = select_lanes(settles & goes_up, interval->above + 1.0f, interval->above);
        interval->below = select_lanes(settles & !goes_up, interval->below - 1.0f, interval->below);

        const intl address = owned_pixel(line, group, map, p, settles, writer->spare, guard);
        if (line.along) {
            const int ahead = PREFETCH_STEPS * map.dst_pitch;
            const intl soon = address + select_lanes(goes_up, (intl)ahead, (intl)-ahead);
            prefetch_across_rows(hits, clamp(soon, (intl)0, (intl)(map.dst_height * map.dst_pitch - 1)), group);
        }
        const floatl met = (a.q + f * (b.q - a.q)) / w;
        const intl hides = select_lanes(goes_up, (intl)writer->up_hides, (intl)writer->down_hides);
#if ALIGNED
        const floatl value = PACKED_HIT(met, hides);
#else
        const floatl value = PACKED_HIT(as_floatl(as_intl(met) & ~OWN_RAY), hides);
#endif
        floatl stored = value;
        if (any_lane(settles & (p >= interval->first) & (p <= interval->last))) {
            const floatl before = (floatl)(gather(hits, address));
            stored = select_lanes(before == EMPTY, value, before);
        }
#if LANES == 1
        hits[address] = stored;
#else
        EACH_LANE(STORE_LANE)
#endif
    }
}

/* Homogeneous target positions of points along lines of the source. At nearness 0 they are affine functions of the
 * distance walked. */
typedef struct {
    floatl p_0, p_1, w_0, w_1, q_0, q_1;
    float b_p, b_w, b_q; /* change per unit of nearness */
} Targets;

INLINED Targets targets_of(PixelMap map, int along, floatl u, floatl v, floatl du, floatl dv)
{
    const float *D = map.dst_from_src;
    Targets targets;
    targets.p_0 = AXIS_ENTRY(D, along, 0) * u + AXIS_ENTRY(D, along, 1) * v + AXIS_ENTRY(D, along, 2);
    targets.p_1 = AXIS_ENTRY(D, along, 0) * du + AXIS_ENTRY(D, along, 1) * dv;
    targets.w_0 = PIXEL_ROW(D, 2, u, v);
    targets.w_1 = D[8] * du + D[9] * dv;
    targets.q_0 = PIXEL_ROW(D, 3, u, v);
    targets.q_1 = D[12] * du + D[13] * dv;
    targets.b_p = AXIS_ENTRY(D, along, 3);
    targets.b_w = D[11];
    targets.b_q = D[15];
    return targets;
}

/* The same, as functions of the lines' major coordinates instead of distances */
INLINED Targets targets_along(PixelMap map, SweepLines line)
{
    return targets_of(map, line.along, select_lanes(line.u_major, (floatl)0.0f, line.minor_0),
                      select_lanes(line.u_major, line.minor_0, (floatl)0.0f),
                      select_lanes(line.u_major, (floatl)1.0f, line.tilt),
                      select_lanes(line.u_major, line.tilt, (floatl)1.0f));
}

INLINED Projection project_at(Targets targets, floatl distance, floatl nearness)
{
    Projection place;
    place.nearness = nearness;
    place.p = targets.p_0 + targets.p_1 * distance + nearness * targets.b_p;
    place.w = targets.w_0 + targets.w_1 * distance + nearness * targets.b_w;
    place.q = targets.q_0 + targets.q_1 * distance + nearness * targets.b_q;
    return place;
}

INLINED Interval nothing_settled(SweepLines line)
{
    Interval interval;
    interval.ended = -1;
    interval.begun = 0;
    interval.first = INFINITY;
    interval.last = -INFINITY;
    interval.above = line.low;
    interval.below = line.low - 1.0f;
    return interval;
}
#endif
