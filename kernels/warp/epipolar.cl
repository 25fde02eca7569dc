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
 */
#include "lib/lanes.h"
#include "lib/surface.h"

/* Equally spaced epipolar lines of the target; "along" is the axis that they advance in, "across" the other. */
typedef struct {
    int axis;                    /* along x: 0, along y: 1 */
    int side;                    /* which side of the epipole: the sign of D along the axis */
    int first_packet;            /* this group's first work-item */
    int count;                   /* lines */
    int low, high;               /* pixels along, inclusive */
    int cross_low, cross_high;   /* pixels across, inclusive */
    int levels;                  /* how often the distance to the epipole is halved within the image */
    float reference;             /* pixel along at which lines of level 0 are 1 pixel apart */
    float first, spacing;        /* pixel across of the first line there, and from line to line */
    float distance, distance_step; /* distance to the epipole, 1 at the reference: distance + distance_step * along */
    float least;                   /* no pixel at this distance or nearer is these lines' */
} LineGroup;

#define STORE_LANE(l) seen[address.s##l] = stored.s##l;

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

kernel void epipolar_sweep(global const float *nearness, global float *seen, global const LineGroup *groups,
                           int group_count, int packet_count, PixelMap map, Cut cut, int shown, float nearest,
                           float farthest
#ifdef COUNT_SAMPLES
                           ,
                           global uint *counts /* (packet_count, 2): samples and pixels visited */
#endif
)
{
    const int packet = get_global_id(0);
    if (packet >= packet_count)
        return;
    int g = 0;
    while (g + 1 < group_count && packet >= groups[g + 1].first_packet)
        g++;
    const LineGroup group = groups[g];
    const int along = group.axis, across = 1 - along;
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    const float b_along = D[4 * along + 3], b_across = D[4 * across + 3], b_w = D[11];
    const float e_u = S[3], e_v = S[7], e_w = S[11], e_q = S[15];

    /* The lines of this packet in the target: across = start + slope * along. */
    const intl index = (packet - group.first_packet) * LANES + lane_index;
    const intl in_group = index < group.count;
    const floatl at_reference = group.first + group.spacing * to_floatl(index);
    const floatl slope = (at_reference * b_w - b_across) / (group.reference * b_w - b_along);
    const floatl start = at_reference - slope * group.reference;
    const floatl steep = pick(fabs(slope) < 1e-12f, (floatl)1e-12f, slope);
    const floatl cross_0 = (group.cross_low - 0.5f - start) / steep, cross_1 = (group.cross_high + 0.5f - start) / steep;
    const floatl low = fmax((floatl)group.low, ceil(fmin(cross_0, cross_1)));
    const floatl high = fmin((floatl)group.high, floor(fmax(cross_0, cross_1)));
    const intl reaches = in_group & (low <= high);
    if (!any_lane(reaches))
        return;

    /* The same lines in the source. Direction: away from the epipole as the ray recedes. */
    const floatl x = along ? at_reference : (floatl)group.reference, y = along ? (floatl)group.reference : at_reference;
    const floatl u0 = PIXEL_ROW(S, 0, x, y), v0 = PIXEL_ROW(S, 1, x, y), w0 = PIXEL_ROW(S, 2, x, y);
    const floatl dir_u = u0 * e_w - e_u * w0, dir_v = v0 * e_w - e_v * w0, offset = e_u * v0 - e_v * u0;
    const intl u_major = fabs(dir_u) >= fabs(dir_v);
    const floatl dir_major = pick(u_major, dir_u, dir_v);
    const floatl tilt = pick(u_major, dir_v, dir_u) / dir_major;
    const floatl minor_0 = pick(u_major, -offset, offset) / dir_major;
    const floatl sign = pick(dir_major < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    const floatl last_major = to_floatl(pick(u_major, (intl)(map.src_width - 1), (intl)(map.src_height - 1)));
    const intl last_minor = pick(u_major, (intl)(map.src_height - 1), (intl)(map.src_width - 1));
    const intl stride_major = pick(u_major, (intl)1, (intl)map.src_pitch);
    const intl stride_minor = pick(u_major, (intl)map.src_pitch, (intl)1);

    /* Clip the source line: to the image, to this side of the epipole, to what the range of depth can show. */
    floatl from = 0.0f, to = last_major;
    const floatl tilted = pick(fabs(tilt) < 1e-12f, (floatl)1e-12f, tilt);
    const floatl edge_0 = -minor_0 / tilted, edge_1 = (to_floatl(last_minor) - minor_0) / tilted;
    from = fmax(from, fmin(edge_0, edge_1));
    to = fmin(to, fmax(edge_0, edge_1));
    const floatl e_major = pick(u_major, (floatl)e_u, (floatl)e_v);
    if (e_w != 0.0f) {
        const floatl epipole = e_major / e_w;
        const intl after = e_w * sign > 0.0f; /* samples follow the epipole on the axis */
        from = pick(after, fmax(from, epipole), from);
        to = pick(after, to, fmin(to, epipole));
    }
    floatl reach_low = INFINITY, reach_high = -INFINITY;
    intl bounded = 1;
    for (int corner = 0; corner < 4; corner++) {
        const floatl p = corner & 1 ? low - 1.0f : high + 1.0f, c = start + slope * p;
        const float q = corner & 2 ? nearest : farthest;
        const floatl px = along ? c : p, py = along ? p : c;
        const floatl cu = PIXEL_ROW(S, 0, px, py), cv = PIXEL_ROW(S, 1, px, py), cw = PIXEL_ROW(S, 2, px, py), cq = PIXEL_ROW(S, 3, px, py);
        const floatl whole = cw * e_q - e_w * cq, part = e_q - q * e_w;
        const floatl at = (pick(u_major, cu, cv) * part + e_major * (q * cw - cq)) / whole;
        bounded = bounded & (whole * part > 0.0f);
        reach_low = fmin(reach_low, at);
        reach_high = fmax(reach_high, at);
    }
    from = pick(bounded, fmax(from, reach_low - 1.0f), from);
    to = pick(bounded, fmin(to, reach_high + 1.0f), to);
    /* One sample more at each end: what lies between the last sample and the clip belongs to the line, too. */
    from = fmax(ceil(from) - 1.0f, (floatl)0.0f);
    to = fmin(floor(to) + 1.0f, last_major);
    const intl steps = pick(reaches & (from <= to), to_intl(to - from), (intl)-1);
    floatl major = pick(sign > 0.0f, from, to);

    /* Homogeneous target position along the line, at nearness 0: affine in the major coordinate. */
    const floatl u_0 = pick(u_major, (floatl)0.0f, minor_0), u_1 = pick(u_major, (floatl)1.0f, tilt);
    const floatl v_0 = pick(u_major, minor_0, (floatl)0.0f), v_1 = pick(u_major, tilt, (floatl)1.0f);
    const floatl p_0 = PIXEL_ROW(D, along, u_0, v_0), p_1 = D[4 * along] * u_1 + D[4 * along + 1] * v_1;
    const floatl w_0 = PIXEL_ROW(D, 2, u_0, v_0), w_1 = D[8] * u_1 + D[9] * v_1;
    const floatl q_0 = PIXEL_ROW(D, 3, u_0, v_0), q_1 = D[12] * u_1 + D[13] * v_1;
    const float b_q = D[15];

    const float innermost = 1 << group.levels;
    const int front_is_up = group.side < 0; /* -D is towards larger pixels */
    const floatl up = front_is_up ? (shown & SHOWS_FRONT ? 0.0f : BLOCKED) : (shown & SHOWS_BACK ? 0.0f : BLOCKED);
    const floatl down = front_is_up ? (shown & SHOWS_BACK ? 0.0f : BLOCKED) : (shown & SHOWS_FRONT ? 0.0f : BLOCKED);
    const float guard = 5e-7f * (map.dst_width + map.dst_height); /* rounding: no pixel may have two owners */

    const intl spare = map.dst_height * map.dst_pitch + packet * LANES + lane_index; /* for lanes with nothing to write */

    floatl q = NO_SURFACE, p1 = 0.0f, w1 = 1.0f, q1 = 0.0f; /* the sample, and its homogeneous target position */
    floatl above = low;                                    /* the settled interval is [below + 1, above - 1] */
    floatl below = low - 1.0f;
    const int last_sample = map.src_height * map.src_pitch - 1, last_pixel = map.dst_height * map.dst_pitch - 1;
    const intl ahead = AHEAD * to_intl(sign) * stride_major;
    const int ahead_p = AHEAD * (along ? map.dst_pitch : 1);
    int gaps = 0; /* a lane has begun anew: pixels outside its interval may be settled, too */
#ifdef COUNT_SAMPLES
    uint samples = 0, pixels = 0;
#define COUNT(counter, mask) for (int l = 0; l < LANES; l++) counter += ((int *)&(mask))[l] != 0;
#else
#define COUNT(counter, mask)
#endif
    for (int step = 0; any_lane(step <= steps); step++, major += sign) {
        const intl active = step <= steps;
        COUNT(samples, active)
        const intl m = clamp(to_intl(major), (intl)0, to_intl(last_major));
        const floatl minor = lesser(greater(minor_0 + tilt * major, (floatl)0.0f), to_floatl(last_minor));
        const intl cell = max(min(to_intl(minor), last_minor - 1), (intl)0);
        const floatl part = minor - to_floatl(cell);
        const intl at = m * stride_major + cell * stride_minor;
#if LANES == 16
        FORESEE(nearness, at, ahead, last_sample)
#endif
        const intl next = at + pick(last_minor > 0, stride_minor, (intl)0);
        const floatl qa = (floatl)(gather(nearness, at)), qb = (floatl)(gather(nearness, next));
        const floatl q_before = q, p0 = p1, w0_ = w1, q0 = q1;
        const intl torn = IS_OPEN(cut, greater(qa, qb), lesser(qa, qb));
        q = pick(torn, pick(part < 0.5f, qa, qb), qa + part * (qb - qa));
        p1 = p_0 + p_1 * major + q * b_along;
        w1 = w_0 + w_1 * major + q * b_w;
        q1 = q_0 + q_1 * major + q * b_q;
        intl open = IS_OPEN(cut, greater(q, q_before), lesser(q, q_before)) | !active;
        if (!map.dst_perspective) /* behind an orthographic target's image plane */
            open = open | (q0 >= 0.0f) | (q1 >= 0.0f);

        /* After a gap, or out of the plane of the target's centre, a new interval begins where the line stands. */
        const intl emerges = (w0_ <= 0.0f) & (w1 > 0.0f) & !open;
        if (any_lane((open & active) | emerges)) {
            const floatl crossing = p0 * w1 - p1 * w0_; /* sign of p where w = 0 between a negative and a positive w */
            const floatl t = pick(emerges, pick(crossing > 0.0f, (floatl)1e9f, (floatl)-1e9f), p1 / w1);
            const floatl fresh = floor_lanes(lesser(greater(t, low - 1.0f), high));
            gaps |= step > 0;
            below = pick(open | emerges, fresh, below);
            above = pick(open | emerges, fresh + 1.0f, above);
        }

        for (;;) {
            const intl goes_up = !open & (p1 - above * w1 >= 0.0f) & (above <= high);
            const intl goes_down = !open & (p1 - below * w1 < 0.0f) & (below >= low);
            if (!any_lane(goes_up | goes_down))
                break;
            const floatl p = pick(goes_up, above, below);
            const floatl g0 = p0 - p * w0_, g1 = p1 - p * w1;
            const floatl f = lesser(greater(g0 / (g0 - g1), (floatl)0.0f), (floatl)1.0f);
            const floatl w = w0_ + f * (w1 - w0_);
            const intl settles = (goes_up | goes_down) & (w > 0.0f);
            if (!any_lane(settles))
                break;
            COUNT(pixels, settles)
            above = pick(settles & goes_up, above + 1.0f, above);
            below = pick(settles & !goes_up, below - 1.0f, below);

            const floatl at_line = start + slope * p, c = floor_lanes(at_line + 0.5f);
            const floatl distance = group.distance + group.distance_step * p;
            /* Lines are 1/2 to 1 pixel apart in each ring, less within the last one. */
            const floatl in_ring = as_floatl(((as_intl(distance) - 1) & 0x007fffff) | 0x3f000000);
            const floatl apart = lesser(in_ring, distance * innermost);
            const floatl D_along = (p * b_w - b_along) * group.side, D_across = fabs(c * b_w - b_across);
            const intl in_wedge = along ? (D_along > D_across) : (D_along >= D_across);
            const intl owns = in_wedge & (fabs(at_line - c) < 0.5f * apart - guard) & (distance > group.least) &
                              (c >= group.cross_low) & (c <= group.cross_high);
            const intl pc = to_intl(c), pa = to_intl(p);
            const intl address = pick(settles & owns, along ? pa * map.dst_pitch + pc : pc * map.dst_pitch + pa, spare);
#if LANES == 16
            if (along)
                FORESEE(seen, address, pick(goes_up, (intl)ahead_p, (intl)-ahead_p), last_pixel)
#endif
            const floatl blocked = pick(goes_up, up, down);
            const floatl value = pick(blocked < 0.0f, blocked, (q0 + f * (q1 - q0)) / w);
            floatl stored = value;
            if (gaps) {
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
#ifdef COUNT_SAMPLES
    counts[2 * packet] = samples;
    counts[2 * packet + 1] = pixels;
#endif
}
