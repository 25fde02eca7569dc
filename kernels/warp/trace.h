/* Rays of the target against the triangulated grid of the source, exactly, each along its own epipolar line.
 *
 * In the source's pixel space a ray is Y(n) = start + n * centre, n being the nearness in the target, and its image is
 * a straight line, walked away from the epipole. The first triangle that the ray crosses is what it sees. The walk
 * goes from cell to cell; in each, the line passes one triangle and then the other. The surface's lead over the ray
 * is affine over a triangle: where it changes its sign, the ray meets the triangle.
 *
 * Cost: the cells of the parts of the line that are looked at, for the slowest of LANES rays.
 */
#include "lib/lanes.h"
#include "lib/surface.h"

typedef struct {
    global const float *nearness;
    int width, height, pitch;
    Cut cut;
} Grid;

/* One ray a lane; all of them pass the target's centre, which is the epipole of the source. */
typedef struct {
    floatl u, v, w, q; /* at target nearness 0 */
    float4 centre;
    int perspective; /* the target is */
} Rays;

/* The plane of a triangle: nearness is q + gu (u - x) + gv (v - y). */
typedef struct {
    floatl q, gu, gv, x, y;
} Plane;

/* The rays' epipolar lines, by the distance walked along their major axis. */
typedef struct {
    floatl u, v, du, dv;       /* position at distance 0, and its change */
    floatl near, near_step;    /* the ray's nearness there, and its change */
    floatl length;             /* distance to walk; < 0: nothing */
    intl along_row, along_column, along_diagonal; /* it runs along edges of the grid */
} Lines;

#define STRETCHES_MOST 9

/* The parts of a line that are looked at, in order: from ... to, and `reach` to either side of the places that follow
 * (INFINITY: none). */
typedef struct {
    floatl from, to;
    floatl next[STRETCHES_MOST - 1];
    int count; /* of next */
    float reach;
} Stretches;

Rays rays_of(PixelMap map, floatl x, float y)
{
    const float *S = map.src_from_dst;
    Rays rays;
    rays.u = PIXEL_ROW(S, 0, x, y);
    rays.v = PIXEL_ROW(S, 1, x, y);
    rays.w = PIXEL_ROW(S, 2, x, y);
    rays.q = PIXEL_ROW(S, 3, x, y);
    rays.centre = (float4)(S[3], S[7], S[11], S[15]);
    rays.perspective = map.dst_perspective;
    return rays;
}

/* Target nearness at which the rays meet a plane; per_unit > 0: its front. */
floatl meet(Rays rays, Plane plane, floatl *per_unit)
{
    const float4 c = rays.centre;
    const floatl at_start = rays.q - plane.q * rays.w - plane.gu * (rays.u - plane.x * rays.w) - plane.gv * (rays.v - plane.y * rays.w);
    *per_unit = c.w - plane.q * c.z - plane.gu * (c.x - plane.x * c.z) - plane.gv * (c.y - plane.y * c.z);
    return -at_start / *per_unit;
}

/* Where the lines run, from the epipole (or the image's border) to the border (or the epipole). */
Lines lines_of(Rays rays, Grid grid)
{
    const float4 c = rays.centre;
    const floatl dir_u = rays.u * c.z - c.x * rays.w, dir_v = rays.v * c.z - c.y * rays.w, offset = c.x * rays.v - c.y * rays.u;
    const intl u_major = fabs(dir_u) >= fabs(dir_v);
    const floatl major = pick(u_major, dir_u, dir_v), start = pick(u_major, rays.u, rays.v);
    const floatl centre = pick(u_major, (floatl)c.x, (floatl)c.y);
    const floatl sign = pick(major < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    const floatl tilt = pick(u_major, dir_v, dir_u) / major;
    const floatl minor = pick(u_major, -offset, offset) / major;
    const floatl slope = (rays.q * c.z - c.w * rays.w) / major, level = (c.w * start - rays.q * centre) / major;

    /* Clip to the image, and by a little beyond its border: rounding. */
    const float last_u = grid.width - 1, last_v = grid.height - 1;
    const floatl last_minor = pick(u_major, (floatl)last_v, (floatl)last_u);
    const floatl tilted = pick(fabs(tilt) < 1e-12f, (floatl)1e-12f, tilt);
    const floatl edge_0 = (-ON_SAMPLES - minor) / tilted, edge_1 = (last_minor + ON_SAMPLES - minor) / tilted;
    floatl low = fmax((floatl)0.0f, fmin(edge_0, edge_1));
    floatl high = fmin(pick(u_major, (floatl)last_u, (floatl)last_v), fmax(edge_0, edge_1));
    /* To this side of the epipole, */
    if (c.z != 0.0f) {
        const floatl epipole = centre / c.z;
        const intl after = c.z * sign > 0.0f;
        low = pick(after, fmax(low, epipole), low);
        high = pick(after, high, fmin(high, epipole));
    }
    /* and to what lies before the target: nearness 0 is infinity, or an orthographic camera's own plane. */
    const intl ahead = rays.w > 0.0f, rising = sign > 0.0f;
    const floatl border = start / rays.w;
    const intl cuts_high = ahead & (rays.perspective ? rising : !rising);
    const intl cuts_low = ahead & (rays.perspective ? !rising : rising);
    high = pick(cuts_high, fmin(high, border), high);
    low = pick(cuts_low, fmax(low, border), low);

    Lines lines;
    const floatl from = pick(rising, low, high);
    const floatl at_minor = minor + tilt * from;
    lines.u = pick(u_major, from, at_minor);
    lines.v = pick(u_major, at_minor, from);
    lines.du = sign * pick(u_major, (floatl)1.0f, tilt);
    lines.dv = sign * pick(u_major, tilt, (floatl)1.0f);
    lines.near = level + slope * from;
    lines.near_step = slope * sign;
    const intl runs = (fabs(major) > 0.0f) & isfinite_lanes(tilt) & isfinite_lanes(at_minor);
    lines.length = pick(runs, high - low, (floatl)-1.0f);

    /* Along the grid's edges: exactly there. */
    const floatl long_ = fmax(lines.length, (floatl)1.0f);
    const floatl row = floor_lanes(lines.v + 0.5f), column = floor_lanes(lines.u + 0.5f);
    const floatl diagonal = floor_lanes(lines.u + lines.v + 0.5f);
    const floatl turn = lines.du + lines.dv;
    lines.along_row = (fabs(lines.dv) * long_ < ON_SAMPLES) & (fabs(lines.v - row) < ON_SAMPLES);
    lines.along_column = (fabs(lines.du) * long_ < ON_SAMPLES) & (fabs(lines.u - column) < ON_SAMPLES);
    lines.along_diagonal = (fabs(turn) * long_ < ON_SAMPLES) & (fabs(lines.u + lines.v - diagonal) < ON_SAMPLES);
    lines.dv = pick(lines.along_row, (floatl)0.0f, pick(lines.along_diagonal, -lines.du, lines.dv));
    lines.du = pick(lines.along_column, (floatl)0.0f, lines.du);
    lines.v = pick(lines.along_row, row, pick(lines.along_diagonal, diagonal - lines.u, lines.v));
    lines.u = pick(lines.along_column, column, lines.u);
    return lines;
}

/* The distance along the lines at which a target nearness lies. */
floatl distance_of(Rays rays, Lines lines, floatl nearness)
{
    const floatl w = rays.w + nearness * rays.centre.z;
    const floatl u = (rays.u + nearness * rays.centre.x) / w, v = (rays.v + nearness * rays.centre.y) / w;
    return pick(fabs(lines.du) >= fabs(lines.dv), (u - lines.u) * lines.du, (v - lines.v) * lines.dv);
}

/* The first triangle that the rays cross on stretches of their lines: target nearness, BLOCKED, or EMPTY if they meet
 * none. Which cell comes next is not foreseeable: selections, no branches. */
floatl trace(Grid grid, Rays rays, Lines lines, Stretches stretches, int shown, intl wanted, uint *cells)
{
    const floatl du = lines.du, dv = lines.dv;
    const floatl step_u = pick(du < 0.0f, (floatl)-1.0f, (floatl)1.0f), step_v = pick(dv < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    const floatl ahead_u = pick(du > 0.0f, (floatl)1.0f, (floatl)0.0f), ahead_v = pick(dv > 0.0f, (floatl)1.0f, (floatl)0.0f);
    const floatl per_u = pick(du == 0.0f, (floatl)0.0f, 1.0f / du), never_u = pick(du == 0.0f, (floatl)INFINITY, (floatl)0.0f);
    const floatl per_v = pick(dv == 0.0f, (floatl)0.0f, 1.0f / dv), never_v = pick(dv == 0.0f, (floatl)INFINITY, (floatl)0.0f);
    const floatl turn = du + dv, start_d = lines.u + lines.v;
    const floatl per_d = 1.0f / turn;
    const intl lower_first = turn >= 0.0f;
    const floatl touch = ON_SAMPLES * fabs(lines.near_step); /* a lead that a step of that length makes */

    /* A line along edges sees cells that are folded onto them. */
    const floatl last_x = pick(lines.along_column, (floatl)(grid.width - 1), (floatl)max(grid.width - 2, 0));
    const floatl last_y = pick(lines.along_row, (floatl)(grid.height - 1), (floatl)max(grid.height - 2, 0));
    const intl right = pick(lines.along_column, (intl)0, (intl)min(grid.width - 1, 1));
    const intl down = pick(lines.along_row, (intl)0, (intl)(grid.height > 1 ? grid.pitch : 0));

    floatl at = fmax(stretches.from, (floatl)0.0f), to = fmin(stretches.to, lines.length), lead = 0.0f, x = 0.0f, y = 0.0f;
    intl active = wanted & (at <= lines.length), begins = active, connected = 0;
    floatl result = EMPTY;
    Plane met_plane = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    intl is_met = 0;
    for (;;) {
        /* At the end of a stretch, on to the next one. */
        const intl over = active & !begins & (at >= to);
        if (any_lane(over)) {
            const floatl next = stretches.next[0], from = next - stretches.reach;
            for (int i = 0; i + 1 < stretches.count; i++)
                stretches.next[i] = pick(over, stretches.next[i + 1], stretches.next[i]);
            if (stretches.count > 0)
                stretches.next[stretches.count - 1] = pick(over, (floatl)INFINITY, stretches.next[stretches.count - 1]);
            to = pick(over, fmin(next + stretches.reach, lines.length), to);
            begins = over & (from > at);
            at = pick(begins, from, at);
            active = active & (at < lines.length) & !(over & (next == INFINITY));
        }
        if (!any_lane(active))
            break;
        if (any_lane(begins)) {
            const floatl u = lines.u + du * at, v = lines.v + dv * at;
            x = pick(begins, pick(du < 0.0f, ceil_lanes(u) - 1.0f, floor_lanes(u)), x);
            y = pick(begins, pick(dv < 0.0f, ceil_lanes(v) - 1.0f, floor_lanes(v)), y);
            connected = connected & !begins;
            begins = 0;
        }
        *cells += 1;

        /* The cell's samples. */
        const floatl xc = lesser(greater(x, (floatl)0.0f), last_x), yc = lesser(greater(y, (floatl)0.0f), last_y);
        const intl base = to_intl(yc) * grid.pitch + to_intl(xc);
        const intl i10 = base + right, i01 = base + down;
        const intl i00 = pick(lines.along_diagonal, i10, base), i11 = pick(lines.along_diagonal, i10, i01 + right);
        const floatl q00 = (floatl)(gather(grid.nearness, i00)), q10 = (floatl)(gather(grid.nearness, i10)),
                     q01 = (floatl)(gather(grid.nearness, i01)), q11 = (floatl)(gather(grid.nearness, i11));

        /* Where the line leaves it, and where it passes from one triangle to the other, if it does. */
        const floatl out_u = (x + ahead_u - lines.u) * per_u + never_u, out_v = (y + ahead_v - lines.v) * per_v + never_v;
        const floatl out = lesser(greater(lesser(out_u, out_v), at), lines.length);
        const floatl diagonal = (xc + yc + 1.0f - start_d) * per_d, crossing = lesser(greater(diagonal, at), out);
        const intl no_first = !(diagonal > at), no_second = diagonal >= out; /* along the diagonal it is all one */

        /* The surface's lead over the ray at the ends of both parts. */
        const floatl u_0 = lines.u - xc + du * at, v_0 = lines.v - yc + dv * at;
        const floatl u_1 = lines.u - xc + du * crossing, v_1 = lines.v - yc + dv * crossing;
        const floatl u_2 = lines.u - xc + du * out, v_2 = lines.v - yc + dv * out;
        const floatl near_0 = lines.near + lines.near_step * at, near_1 = lines.near + lines.near_step * crossing,
                     near_2 = lines.near + lines.near_step * out;
        const floatl lower_u = q10 - q00, lower_v = q01 - q00, upper_u = q11 - q01, upper_v = q11 - q10;
        const floatl lower_end = q00 + lower_u * pick(lower_first, u_0, u_2) + lower_v * pick(lower_first, v_0, v_2);
        const floatl upper_end = q10 + upper_u * (pick(lower_first, u_2, u_0) - 1.0f) + upper_v * pick(lower_first, v_2, v_0);
        const floatl lower_1 = q00 + lower_u * u_1 + lower_v * v_1, upper_1 = q10 + upper_u * (u_1 - 1.0f) + upper_v * v_1;
        const floatl first_1 = pick(lower_first, lower_1, upper_1) - near_1, second_1 = pick(lower_first, upper_1, lower_1) - near_1;
        const floatl lead_0 = pick(connected, lead, pick(no_first, second_1, pick(lower_first, lower_end, upper_end) - near_0));
        const floatl lead_1 = pick(no_first, lead_0, first_1);
        const floatl lead_2 = pick(no_second, lead_1, pick(lower_first, upper_end, lower_end) - near_2);
        const intl beyond = lines.along_diagonal & ((x != xc) | (y != yc)); /* of the grid, by rounding */
        const floatl high = greater(q10, q01), low = lesser(q10, q01);
        const intl lower_open = beyond | IS_OPEN(grid.cut, greater(high, q00), lesser(low, q00));
        const intl upper_open = beyond | IS_OPEN(grid.cut, greater(high, q11), lesser(low, q11));
        const intl open_1 = no_first | pick(lower_first, lower_open, upper_open);
        const intl open_2 = no_second | pick(lower_first, upper_open, lower_open);
        const floatl entry_2 = pick(open_1 & !no_first, second_1, lead_1);

        /* Surfaces end with their last sample, not before it: hence the touch. */
        const intl front_1 = !open_1 & (lead_0 < touch) & (lead_1 >= -touch) & (lead_1 > lead_0);
        const intl back_1 = !open_1 & (lead_0 > 0.0f) & (lead_1 <= 0.0f);
        const intl front_2 = !open_2 & (entry_2 < touch) & (lead_2 >= -touch) & (lead_2 > entry_2);
        const intl back_2 = !open_2 & (entry_2 > 0.0f) & (lead_2 <= 0.0f);
        const intl meets_1 = front_1 | back_1;
        const intl meets = active & (meets_1 | front_2 | back_2);
        if (any_lane(meets)) {
            const intl front = (meets_1 & front_1) | ((!meets_1) & front_2);
            const intl shows = meets & ((front & (intl)(shown & SHOWS_FRONT ? -1 : 0)) | ((!front) & (intl)(shown & SHOWS_BACK ? -1 : 0)));
            const intl lower = (meets_1 & lower_first) | (!(meets_1 | lower_first));
            met_plane.q = pick(shows, pick(lower, q00, q10), met_plane.q);
            met_plane.gu = pick(shows, pick(lower, lower_u, upper_u), met_plane.gu);
            met_plane.gv = pick(shows, pick(lower, lower_v, upper_v), met_plane.gv);
            met_plane.x = pick(shows, pick(lower, xc, xc + 1.0f), met_plane.x);
            met_plane.y = pick(shows, yc, met_plane.y);
            is_met = is_met | shows;
            result = pick(meets & !shows, (floatl)BLOCKED, result);
            active = active & !meets;
        }

        /* On to the next cell. */
        lead = lead_2;
        connected = pick(no_second, pick(no_first, connected, !open_1), !open_2);
        x += pick(out_u <= out_v, step_u, (floatl)0.0f);
        y += pick(out_v <= out_u, step_v, (floatl)0.0f);
        at = out;
        active = active & (at < lines.length);
    }
    floatl per_unit;
    const floatl met = meet(rays, met_plane, &per_unit);
    const intl before = rays.perspective ? met > 0.0f : met < 0.0f;
    return pick(is_met & before, met, result);
}
