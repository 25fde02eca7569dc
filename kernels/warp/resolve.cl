/* From what an epipolar line saw to what each pixel's own ray sees, and its depth and colour.
 *
 * The sweep's lines pass within half a pixel of the pixels they settle. Here each pixel's own ray meets the triangle
 * of the source at the line's answer, moves to where it met its plane, and is done when it lies in the triangle it
 * met: on a surface one or two steps. What does not settle so (silhouettes, cuts, rough surfaces) and pixels beside
 * the settled ones that no line reached are traced along their own epipolar line, a few samples around the answer.
 *
 * seen: (dst_height, dst_pitch) nearness by epipolar.cl, or the finished nearness by search.cl. depth, color, valid:
 * (dst_height, dst_width). `merge` keeps what is nearer already. density: pixels of the
 * source over one of the target, >= 1. Work-item: STRIP * LANES pixels of a row.
 * Cost: O(pixels). Determinism: every pixel on its own, from inputs alone.
 */
#include "lib/lanes.h"
#include "lib/color.h"
#include "warp/trace.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES pixels a work-item */
#endif
#define STEPS 3       /* triangles tried before the pixel is traced */
#define STRAY 1.0f    /* pixels of the source by which a hit may lie off the line's: farther off, another surface may come first */
#define WINDOW 4.0f   /* pixels of the source to either side of an answer that are traced */
#define EDGE 2.0f     /* pixels of the source between neighbours' answers that make a depth edge */
#define TOLERANCE 1e-3f /* pixels by which a hit may lie outside its triangle: rounding, not geometry */

/* What the pixel's own ray meets first near the answers of its line and of its neighbours' lines. */
float retrace(Grid grid, global const float *seen, PixelMap map, int shown, int x, int y, float window)
{
    const float *S = map.src_from_dst;
    Ray ray;
    ray.start = (float4)(PIXEL_ROW(S, 0, x, y), PIXEL_ROW(S, 1, x, y), PIXEL_ROW(S, 2, x, y), PIXEL_ROW(S, 3, x, y));
    ray.centre = (float4)(S[3], S[7], S[11], S[15]);
    const Walk whole = walk_of(ray, grid.width, grid.height);
    const int at = y * map.dst_pitch + x;
    const float answers[5] = {seen[at], x > 0 ? seen[at - 1] : EMPTY, x + 1 < map.dst_width ? seen[at + 1] : EMPTY,
                              y > 0 ? seen[at - map.dst_pitch] : EMPTY,
                              y + 1 < map.dst_height ? seen[at + map.dst_pitch] : EMPTY};
    float tried[5];
    float nearest = EMPTY;
    for (int i = 0; i < 5; i++) {
        tried[i] = INFINITY;
        if (!IS_HIT(answers[i]))
            continue;
        const float4 point = ray.start + answers[i] * ray.centre;
        tried[i] = (whole.u_major ? point.x : point.y) / point.z;
        int again = 0;
        for (int j = 0; j < i; j++)
            again |= fabs(tried[i] - tried[j]) < 0.5f * window;
        if (again)
            continue;
        Walk walk = whole;
        const float from = tried[i] - walk.sign * window, to = tried[i] + walk.sign * window;
        walk.from = walk.sign > 0.0f ? fmax(walk.from, from) : fmin(walk.from, from);
        walk.to = walk.sign > 0.0f ? fmin(walk.to, to) : fmax(walk.to, to);
        uint samples = 0;
        nearest = fmax(nearest, trace(grid, ray, walk, shown, &samples));
    }
    return nearest;
}

kernel void resolve(global const float *nearness, global const float *seen, global const channel *src_color,
                    global float *depth, global channel *color, global uchar *valid, PixelMap map, Cut cut, int shown,
                    int linear, int merge, int low_x, int high_x, int low_y, int high_y, float density)
{
    const int y = low_y + get_global_id(1);
    const int strip_x = low_x + get_global_id(0) * (STRIP * LANES);
    if (y >= high_y || strip_x >= high_x)
        return;
    const float *S = map.src_from_dst, *D = map.dst_from_src;
    const float e_u = S[3], e_v = S[7], e_w = S[11], e_q = S[15];
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
    const float stray = STRAY * density;
    const int last_cell_x = max(map.src_width - 2, 0), last_cell_y = max(map.src_height - 2, 0);
    const int step_x = min(map.src_width - 1, 1), step_y = min(map.src_height - 1, 1); /* 0 in an image of one column */

    for (int x0 = strip_x; x0 < min(strip_x + STRIP * LANES, high_x); x0 += LANES) {
        const intl xi = x0 + lane_index;
        const floatl x = to_floatl(xi);
        global const float *here = seen + (size_t)y * map.dst_pitch + x0; /* the pitch leaves room for a whole packet */
        const floatl answer = load_lanes(here);
        floatl n = answer;
        const intl inside_image = xi < high_x;
        intl hit = IS_HIT(n) & inside_image;
        intl settled = 0, edge = 0;
        const floatl u0 = PIXEL_ROW(S, 0, x, y), v0 = PIXEL_ROW(S, 1, x, y), w0 = PIXEL_ROW(S, 2, x, y), q0 = PIXEL_ROW(S, 3, x, y);
        floatl u = 0.0f, v = 0.0f, fu = 0.0f, fv = 0.0f;
        intl cell_x = 0, cell_y = 0, upper = 0; /* the triangle that is hit */

        floatl nearer = greater(y > 0 ? load_lanes(here - map.dst_pitch) : n,
                                y + 1 < map.dst_height ? load_lanes(here + map.dst_pitch) : n);
        nearer = greater(nearer, greater(x0 > 0 ? load_lanes(here - 1) : shifted_lanes(n), load_lanes(here + 1)));
        if (any_lane(hit)) {
            const floatl inverse = 1.0f / (w0 + n * e_w);
            u = (u0 + n * e_u) * inverse;
            v = (v0 + n * e_v) * inverse;
            const floatl u_line = u, v_line = v;
            /* Beside a nearer surface the ray may meet that one. */
            const floatl moves_by = (fabs(e_u - u * e_w) + fabs(e_v - v * e_w)) * fabs(inverse);
            edge = hit & ((nearer - n) * moves_by > EDGE * density);
            for (int step = 0; step < STEPS; step++) {
                const floatl uc = lesser(greater(floor(u), (floatl)0.0f), (floatl)last_cell_x);
                const floatl vc = lesser(greater(floor(v), (floatl)0.0f), (floatl)last_cell_y);
                const intl is_upper = (u - uc) + (v - vc) > 1.0f;
                const intl base = to_intl(vc) * map.src_pitch + to_intl(uc);
                const intl i10 = base + step_x, i01 = base + step_y * map.src_pitch;
                const intl ic = pick(is_upper, i01 + step_x, base);
                const floatl q10 = (floatl)(gather(nearness, i10)), q01 = (floatl)(gather(nearness, i01)),
                             qc = (floatl)(gather(nearness, ic));
                const floatl gu = pick(is_upper, qc - q01, q10 - qc), gv = pick(is_upper, qc - q10, q01 - qc);
                const floatl cu = uc + pick(is_upper, (floatl)1.0f, (floatl)0.0f);
                const floatl cv = vc + pick(is_upper, (floatl)1.0f, (floatl)0.0f);
                const intl open = IS_OPEN(cut, greater(qc, greater(q10, q01)), lesser(qc, lesser(q10, q01)));
                const floatl per_unit = e_q - qc * e_w - gu * (e_u - cu * e_w) - gv * (e_v - cv * e_w);
                const floatl at_start = q0 - qc * w0 - gu * (u0 - cu * w0) - gv * (v0 - cv * w0);
                const floatl met = -at_start / per_unit;
                const floatl w_met = w0 + met * e_w;
                const floatl inverse = 1.0f / w_met;
                const floatl un = (u0 + met * e_u) * inverse, vn = (v0 + met * e_v) * inverse;
                const floatl du = un - uc, dv = vn - vc, diagonal = du + dv;
                const intl in_lower = (du >= -TOLERANCE) & (dv >= -TOLERANCE) & (diagonal <= 1.0f + TOLERANCE);
                const intl in_upper = (du <= 1.0f + TOLERANCE) & (dv <= 1.0f + TOLERANCE) & (diagonal >= 1.0f - TOLERANCE);
                const intl in_triangle = (is_upper & in_upper) | (!is_upper & in_lower);
                const intl shows = ((per_unit > 0.0f) & (intl)(shown & SHOWS_FRONT ? -1 : 0)) |
                                   ((per_unit < 0.0f) & (intl)(shown & SHOWS_BACK ? -1 : 0));
                const intl near = (fabs(un - u_line) < stray) & (fabs(vn - v_line) < stray);
                const floatl level = fabs(e_q - qc * e_w), facing = fabs(per_unit);
                const intl even = (facing > 0.5f * level) & (facing < 2.0f * level);
                const intl settles = hit & !settled & in_triangle & near & even & !open & shows & (w_met > 0.0f);
                const intl moves = !settled;
                fu = pick(moves, du, fu);
                fv = pick(moves, dv, fv);
                u = pick(moves, un, u);
                v = pick(moves, vn, v);
                n = pick(settles, met, n);
                cell_x = pick(moves, to_intl(uc), cell_x);
                cell_y = pick(moves, to_intl(vc), cell_y);
                upper = pick(moves, is_upper, upper);
                settled = settled | settles;
                if (!any_lane(hit & !settled))
                    break;
            }
        }

        /* What is left, one by one. */
        intl left = inside_image & (edge | (!settled & (hit | ((answer == EMPTY) & IS_HIT(nearer)))));
        if (any_lane(left)) {
            for (int lane = 0; lane < LANES; lane++) {
                if (!((int *)&left)[lane])
                    continue;
                const int px = x0 + lane;
                ((int *)&settled)[lane] = 0;
                const float found = retrace(grid, seen, map, shown, px, y, WINDOW * density);
                if (!IS_HIT(found))
                    continue;
                const float w = PIXEL_ROW(S, 2, px, y) + found * e_w;
                const float uf = (PIXEL_ROW(S, 0, px, y) + found * e_u) / w, vf = (PIXEL_ROW(S, 1, px, y) + found * e_v) / w;
                const int uc = clamp((int)floor(uf), 0, last_cell_x);
                const int vc = clamp((int)floor(vf), 0, last_cell_y);
                ((float *)&n)[lane] = found;
                ((float *)&fu)[lane] = uf - uc;
                ((float *)&fv)[lane] = vf - vc;
                ((int *)&cell_x)[lane] = uc;
                ((int *)&cell_y)[lane] = vc;
                ((int *)&upper)[lane] = uf - uc + vf - vc > 1.0f ? -1 : 0;
                ((int *)&settled)[lane] = -1;
            }
        }
        const size_t out = (size_t)y * map.dst_width + x0;
        const int count = min(high_x - x0, LANES);
        fu = lesser(greater(fu, (floatl)0.0f), (floatl)1.0f);
        fv = lesser(greater(fv, (floatl)0.0f), (floatl)1.0f);
        const int pixels = map.src_width * map.src_height;
        const intl row = cell_y * map.src_width + cell_x;
        Color c;
        if (linear) {
            const intl beside = row + step_x, below = row + step_y * map.src_width;
            const intl corner = pick(upper, below + step_x, row);
            const floatl diagonal = fu + fv - 1.0f;
            const floatl at_beside = pick(upper, 1.0f - fv, fu), at_below = pick(upper, 1.0f - fu, fv);
            const floatl at_corner = fabs(diagonal);
            const Color c0 = read_color(src_color, corner, pixels);
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
            const floatl sample = (floatl)(gather(nearness, at)), us = to_floatl(sx), vs = to_floatl(sy);
            const floatl w = PIXEL_ROW(D, 2, us, vs) + D[11] * sample;
            n = pick(w > 0.0f, (PIXEL_ROW(D, 3, us, vs) + D[15] * sample) / w, n);
        }
        const floatl z = DEPTH(map, n);
        if (!merge && count == LANES) {
            store_lanes(pick(settled, z, (floatl)NAN), depth + out);
            c.r = pick(settled, c.r, (floatl)0.0f);
            c.g = pick(settled, c.g, (floatl)0.0f);
            c.b = pick(settled, c.b, (floatl)0.0f);
            write_color(color + 3 * out, c, LANES);
            store_lanes(to_ucharl(settled & 1), valid + out);
            continue;
        }
        for (int lane = 0; lane < count; lane++) {
            const int is_settled = ((const int *)&settled)[lane] != 0;
            const float z_new = ((const float *)&z)[lane], z_old = merge ? depth[out + lane] : NAN;
            if (is_settled ? z_new >= z_old : merge)
                continue; /* what is there is nearer, or there is nothing to add */
            depth[out + lane] = is_settled ? z_new : NAN;
            valid[out + lane] = is_settled;
            Color one = {is_settled ? ((const float *)&c.r)[lane] : 0.0f, is_settled ? ((const float *)&c.g)[lane] : 0.0f,
                         is_settled ? ((const float *)&c.b)[lane] : 0.0f};
            write_color(color + 3 * (out + lane), one, 1);
        }
    }
}
