/* From what an epipolar line saw to what each pixel's own ray sees, and its depth and colour.
 *
 * The sweep's lines pass within half a pixel of the pixels they settle. Here each pixel's own ray meets the triangle
 * of the source at the line's answer, moves to where it met its plane, and is done when it lies in the triangle it
 * met: on a surface one or two steps. What does not settle so (silhouettes, cuts, rough surfaces) and pixels beside
 * the settled ones that no line reached are traced along their own epipolar line, a few samples around the answer.
 * Where neighbours' answers hardly differ, the line's answer is good enough for a nearest sample.
 *
 * seen: (dst_height, dst_pitch) nearness by epipolar.cl, or the finished nearness by search.cl. depth, color, valid:
 * (dst_height, dst_width); merge: keep what is nearer already. density: pixels of the source over one of the target,
 * >= 1. apart: pixels of the target over one of the source, >= 1: what a line missed of the surface by half a sample
 * is that far from what it saw. typical: some nearness that the view has in the target. calm: pixels of the source
 * between neighbours' answers, over a pixel of either image, below which the line's is taken; 0: never.
 * Work-item: STRIP * LANES pixels of a row.
 * Cost: O(pixels). Determinism: every pixel on its own, from inputs alone.
 */
#include "lib/lanes.h"
#include "lib/color.h"
#include "warp/retrace.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES pixels a work-item; more than 1 hides a packet's latency behind the others */
#endif
#define STEPS 3       /* triangles tried before the pixel is traced */
#define STRAY 1.0f    /* pixels of the source by which a hit may lie off the line's: farther off, another surface may come first */
#define EDGE 2.0f     /* pixels of the source between neighbours' answers that make a depth edge */
#define AT_EPIPOLE 1e-2f /* pixels of the target around the epipole that no line settles */
#define TOLERANCE 1e-3f /* pixels by which a hit may lie outside its triangle: rounding, not geometry */

kernel void resolve(global const float *nearness, global const float *seen, global const channel *src_color,
                    global float *depth, global channel *color, global uchar *valid, PixelMap map, Cut cut, int shown,
                    int linear, int merge, int low_x, int high_x, int low_y, int high_y, float density,
                    int apart, float typical, float calm)
{
    const int y = low_y + get_global_id(1);
    const int strip_x = low_x + get_global_id(0) * (STRIP * LANES);
    if (y >= high_y || strip_x >= high_x)
        return;
    const float *S = map.src_from_dst, *D = map.dst_from_src;
    const float e_u = S[3], e_v = S[7], e_w = S[11], e_q = S[15];
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
    const int last_cell_x = max(map.src_width - 2, 0), last_cell_y = max(map.src_height - 2, 0);
    const int step_x = min(map.src_width - 1, 1), step_y = min(map.src_height - 1, 1); /* 0 in an image of one column */
    const int packets = min(STRIP, (high_x - strip_x + LANES - 1) / LANES);
    const int pixels = map.src_width * map.src_height;
    const float last_u = map.src_width - 1 + TOLERANCE, last_v = map.src_height - 1 + TOLERANCE;
    const float stray = STRAY * density;

    /* Per packet: source position and target nearness of the answer or hit; the line's position; lanes that have an
     * answer and are not settled yet; lanes whose answer is a neighbour's; lanes that are settled; lanes to trace. */
    floatl us[STRIP], vs[STRIP], ns[STRIP], line_us[STRIP], line_vs[STRIP];
    intl open_lanes[STRIP], missed_lanes[STRIP], settled_lanes[STRIP], traced_lanes[STRIP];

    for (int p = 0; p < packets; p++) {
        const int x0 = strip_x + p * LANES;
        global const float *here = seen + (size_t)y * map.dst_pitch + x0; /* the pitch leaves room for a whole packet */
        const floatl x = to_floatl(x0 + lane_index);
        const floatl swept = load_lanes(here);
        floatl n = swept;
        if (fabs(y * D[11] - D[7]) <= AT_EPIPOLE * fabs(D[11])) /* no line there, and no parallax */
            n = pick((fabs(x * D[11] - D[3]) <= AT_EPIPOLE * fabs(D[11])) & (n == EMPTY), (floatl)typical, n);
        const floatl above = y > 0 ? load_lanes(here - map.dst_pitch) : n;
        const floatl under = y + 1 < map.dst_height ? load_lanes(here + map.dst_pitch) : n;
        const floatl left = x0 > 0 ? load_lanes(here - 1) : shifted_lanes(n), right = load_lanes(here + 1);
        const floatl nearer = greater(greater(above, under), greater(left, right));
        const floatl farther = lesser(lesser(above, under), lesser(left, right));
        floatl beside = nearer;
        if (apart > 1) {
            beside = greater(beside, y >= apart ? load_lanes(here - apart * map.dst_pitch) : n);
            beside = greater(beside, y + apart < map.dst_height ? load_lanes(here + apart * map.dst_pitch) : n);
            beside = greater(beside, greater(x0 >= apart ? load_lanes(here - apart) : n, load_lanes(here + apart)));
        }
        /* A pixel that no line reached may see on what a neighbour's line saw. */
        const intl inside = x0 + lane_index < high_x, hit = inside & IS_HIT(n);
        const intl missed = inside & (n == EMPTY) & IS_HIT(beside);
        const floatl guess = pick(missed, beside, n);
        const floatl u0 = PIXEL_ROW(S, 0, x, y), v0 = PIXEL_ROW(S, 1, x, y), w0 = PIXEL_ROW(S, 2, x, y);
        const floatl inverse = 1.0f / (w0 + guess * e_w);
        const floatl u = (u0 + guess * e_u) * inverse, v = (v0 + guess * e_v) * inverse;
        /* A pixel beside a nearer surface may see that one. */
        const floatl moves_by = (fabs(e_u - u * e_w) + fabs(e_v - v * e_w)) * fabs(inverse);
        const intl edge = hit & ((nearer - n) * moves_by > EDGE * density);
        const intl on_image = (u >= -TOLERANCE) & (u <= last_u) & (v >= -TOLERANCE) & (v <= last_v);
        const floatl step = (fabs(S[0] - u * S[8]) + fabs(S[4] - v * S[8])) * fabs(inverse); /* from pixel to pixel */
        const floatl differs_by = greater(nearer - n, n - farther) * moves_by;
        const intl is_calm = inside & IS_HIT(swept) & on_image & (differs_by < calm * lesser(step, (floatl)1.0f));
        us[p] = line_us[p] = u;
        vs[p] = line_vs[p] = v;
        ns[p] = guess;
        open_lanes[p] = (hit & !edge & !is_calm) | missed;
        missed_lanes[p] = missed;
        traced_lanes[p] = edge;
        settled_lanes[p] = is_calm;
#if LANES == 16
        const int first_x = clamp(convert_int(u.s0), 0, last_cell_x), first_y = clamp(convert_int(v.s0), 0, last_cell_y);
        const int last_x = clamp(convert_int(u.sf), 0, last_cell_x), last_y = clamp(convert_int(v.sf), 0, last_cell_y);
        foresee(nearness + first_y * map.src_pitch + first_x);
        foresee(nearness + last_y * map.src_pitch + last_x);
        foresee(nearness + (last_y + step_y) * map.src_pitch + last_x);
        foresee(src_color + 3 * (first_y * map.src_width + first_x));
        foresee(src_color + 3 * (last_y * map.src_width + last_x));
        foresee(src_color + 3 * ((last_y + step_y) * map.src_width + last_x));
#endif
    }

    for (int step = 0; step < STEPS; step++) {
        for (int p = 0; p < packets; p++) {
            const intl waiting = open_lanes[p];
            if (!any_lane(waiting))
                continue;
            const floatl x = to_floatl(strip_x + p * LANES + lane_index), u = us[p], v = vs[p];
            const floatl uc = truncated(lesser(greater(u, (floatl)0.0f), (floatl)last_cell_x));
            const floatl vc = truncated(lesser(greater(v, (floatl)0.0f), (floatl)last_cell_y));
            const intl upper = (u - uc) + (v - vc) > 1.0f;
            const intl base = to_intl(vc) * map.src_pitch + to_intl(uc);
            const intl i10 = base + step_x, i01 = base + step_y * map.src_pitch;
            const intl ic = pick(upper, i01 + step_x, base);
            const floatl q10 = (floatl)(gather(nearness, i10)), q01 = (floatl)(gather(nearness, i01)),
                         qc = (floatl)(gather(nearness, ic));
            const floatl gu = pick(upper, qc - q01, q10 - qc), gv = pick(upper, qc - q10, q01 - qc);
            const floatl one = pick(upper, (floatl)1.0f, (floatl)0.0f), cu = uc + one, cv = vc + one;
            const intl open = IS_OPEN(cut, greater(qc, greater(q10, q01)), lesser(qc, lesser(q10, q01)));
            const floatl u0 = PIXEL_ROW(S, 0, x, y), v0 = PIXEL_ROW(S, 1, x, y), w0 = PIXEL_ROW(S, 2, x, y),
                         q0 = PIXEL_ROW(S, 3, x, y);
            const floatl per_unit = e_q - qc * e_w - gu * (e_u - cu * e_w) - gv * (e_v - cv * e_w);
            const floatl at_start = q0 - qc * w0 - gu * (u0 - cu * w0) - gv * (v0 - cv * w0);
            const floatl met = -at_start / per_unit;
            const floatl w_met = w0 + met * e_w, inverse = 1.0f / w_met;
            const floatl u_met = (u0 + met * e_u) * inverse, v_met = (v0 + met * e_v) * inverse;

            const floatl du = u_met - uc, dv = v_met - vc, diagonal = du + dv;
            const intl in_lower = (du >= -TOLERANCE) & (dv >= -TOLERANCE) & (diagonal <= 1.0f + TOLERANCE);
            const intl in_upper = (du <= 1.0f + TOLERANCE) & (dv <= 1.0f + TOLERANCE) & (diagonal >= 1.0f - TOLERANCE);
            const intl in_triangle = (upper & in_upper) | ((!upper) & in_lower);
            const intl shows = ((per_unit > 0.0f) & (intl)(shown & SHOWS_FRONT ? -1 : 0)) |
                               ((per_unit < 0.0f) & (intl)(shown & SHOWS_BACK ? -1 : 0));
            const intl near = (fabs(u_met - line_us[p]) < stray) & (fabs(v_met - line_vs[p]) < stray);
            /* On a surface much steeper or shallower to the ray than a level one, another triangle may come first. */
            const floatl level = fabs(e_q - qc * e_w), facing = fabs(per_unit);
            const intl even = (facing > 0.5f * level) & (facing < 2.0f * level);
            const intl before = map.dst_perspective ? met > 0.0f : met < 0.0f;
            const intl settles = waiting & in_triangle & near & even & shows & !open & (w_met > 0.0f) & before;
            us[p] = pick(waiting, u_met, u);
            vs[p] = pick(waiting, v_met, v);
            ns[p] = pick(settles, met, ns[p]);
            settled_lanes[p] = settled_lanes[p] | settles;
            const intl doubtful = waiting & in_triangle & !settles;
            traced_lanes[p] = traced_lanes[p] | doubtful;
            const intl leaves = missed_lanes[p] & ((u_met < -TOLERANCE) | (u_met > last_u) | (v_met < -TOLERANCE) | (v_met > last_v));
            open_lanes[p] = waiting & !settles & !doubtful & !leaves;
        }
    }

    for (int p = 0; p < packets; p++) {
        const intl traced = traced_lanes[p] | open_lanes[p];
        if (!any_lane(traced))
            continue;
        for (int lane = 0; lane < LANES; lane++) {
            if (!((const int *)&traced)[lane])
                continue;
            const int x = strip_x + p * LANES + lane;
            const float n = retrace(grid, seen, map, shown, x, y, density, apart);
            if (!IS_HIT(n))
                continue;
            const float w = PIXEL_ROW(S, 2, x, y) + n * e_w;
            ((float *)&us[p])[lane] = (PIXEL_ROW(S, 0, x, y) + n * e_u) / w;
            ((float *)&vs[p])[lane] = (PIXEL_ROW(S, 1, x, y) + n * e_v) / w;
            ((float *)&ns[p])[lane] = n;
            ((int *)&settled_lanes[p])[lane] = -1;
        }
    }

    for (int p = 0; p < packets; p++) {
        const int x0 = strip_x + p * LANES, count = min(high_x - x0, LANES);
        const intl settled = settled_lanes[p];
        if (merge && !any_lane(settled))
            continue;
        const floatl u = us[p], v = vs[p];
        const floatl uc = truncated(lesser(greater(u, (floatl)0.0f), (floatl)last_cell_x));
        const floatl vc = truncated(lesser(greater(v, (floatl)0.0f), (floatl)last_cell_y));
        const floatl fu = lesser(greater(u - uc, (floatl)0.0f), (floatl)1.0f);
        const floatl fv = lesser(greater(v - vc, (floatl)0.0f), (floatl)1.0f);
        const intl cell_x = to_intl(uc), cell_y = to_intl(vc);
        floatl n = ns[p];
        Color c;
        if (linear) {
            const floatl diagonal = fu + fv - 1.0f;
            const intl upper = diagonal > 0.0f;
            const intl cell = cell_y * map.src_width + cell_x;
            const intl beside = cell + step_x, below = cell + step_y * map.src_width;
            const floatl at_beside = pick(upper, 1.0f - fv, fu), at_below = pick(upper, 1.0f - fu, fv);
            const floatl at_corner = fabs(diagonal);
            const Color c0 = read_color(src_color, pick(upper, below + step_x, cell), pixels);
            const Color c1 = read_color(src_color, beside, pixels);
            const Color c2 = read_color(src_color, below, pixels);
            c.r = at_corner * c0.r + at_beside * c1.r + at_below * c2.r;
            c.g = at_corner * c0.g + at_beside * c1.g + at_below * c2.g;
            c.b = at_corner * c0.b + at_beside * c1.b + at_below * c2.b;
        } else {
            const intl sx = cell_x + pick(fu >= 0.5f, (intl)step_x, (intl)0);
            const intl sy = cell_y + pick(fv >= 0.5f, (intl)step_y, (intl)0);
            c = read_color(src_color, sy * map.src_width + sx, pixels);
            const intl at = sy * map.src_pitch + sx;
            const floatl q = (floatl)(gather(nearness, at)), sample_u = to_floatl(sx), sample_v = to_floatl(sy);
            const floatl w = PIXEL_ROW(D, 2, sample_u, sample_v) + D[11] * q;
            n = pick(w > 0.0f, (PIXEL_ROW(D, 3, sample_u, sample_v) + D[15] * q) / w, n);
        }
        const floatl z = DEPTH(map, n);
        const size_t out = (size_t)y * map.dst_width + x0;
        if (!merge && count == LANES) {
            store_lanes(pick(settled, z, (floatl)NAN), depth + out);
            store_bytes(to_ucharl(settled & 1), valid + out);
            c.r = pick(settled, c.r, (floatl)0.0f);
            c.g = pick(settled, c.g, (floatl)0.0f);
            c.b = pick(settled, c.b, (floatl)0.0f);
            write_color(color + 3 * out, c);
            continue;
        }
        for (int lane = 0; lane < count; lane++) {
            const int is_settled = ((const int *)&settled)[lane] != 0;
            const float z_new = ((const float *)&z)[lane], z_old = merge ? depth[out + lane] : NAN;
            if (is_settled ? z_new >= z_old : merge)
                continue; /* what is there is nearer, or there is nothing to add */
            depth[out + lane] = is_settled ? z_new : NAN;
            valid[out + lane] = is_settled;
            const float3 one = (float3)(((const float *)&c.r)[lane], ((const float *)&c.g)[lane], ((const float *)&c.b)[lane]);
            write_pixel(color + 3 * (out + lane), is_settled ? one : (float3)(0.0f));
        }
    }
}
