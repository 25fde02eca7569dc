/* Finds why a pixel of the target is a hole, from the part of its ray that the source has seen.
 *
 * A ray is followed along its epipolar line, away from the target. Where the ray is nearer to the source than the
 * surface, the source has seen that space is free. So the pixel shows something beyond the ray's last free place. The
 * region that begins there gives the class: space behind a surface, samples without depth, or the outside of the image.
 * A ray that meets a side of the surface that is not shown ends there; resolve.cl writes the class of its pixel.
 *
 * All pixels of a line (lines.h) share one walk over the columns (or rows) of the source, backwards from the line's
 * end. The first column in which a pixel's ray is free is the ray's last free place. In each column, all rays on one
 * side of the visible surface are free. So the classified pixels form one interval: a step of the walk either
 * classifies the next pixel at the interval's end or goes on to the next column. Where depth is missing, only rays
 * nearer than all samples of the source count as free.
 *
 * told: (dst_height, dst_pitch) this view's result for each pixel: a class, as an int; or, if the line meets the
 * surface although the pixel is a hole, the target nearness where it does: then the class is that of the sample at
 * which the pixel's own ray has this nearness. The initial value 0 stays where no line passes: at the borders between
 * groups of lines, and at the epipole. LANES more values for each packet follow, for lanes that have no pixel to write.
 * Without parallax there are no lines: the host fills the buffer with some nearness.
 * valid: (dst_height, dst_width). classes: (dst_height, dst_width), classes.h: they already hold the results of
 * resolve.cl and of other views; a hole keeps the least class. nearest: the greatest nearness in the source.
 * Work-item: LANES lines (classify_lines); STRIP * LANES pixels of a row (classify). Cost: O(source samples + target
 * pixels) for each line.
 * Determinism: a pixel is written by at most one lane.
 */
#include "warp/classes.h"
#include "warp/interval.h"
#include "warp/trace.h"

#define TELL_LANE(l) told[address.s##l] = value.s##l;

/* Classifies the pixels of a packet of a group's lines. */
OUTLINED void tell_packet(Grid grid, global float *told, LineGroup group, int packet, PixelMap map, float nearest)
{
    const SweepLines line = lines_of(group, map, packet);
    const Targets targets = targets_along(map, line);
    const intl mirrored = line.sign < 0.0f;
    const floatl first = floor_lanes(line.from), last = ceil_lanes(line.to), last_minor = to_floatl(line.last_minor);
    const floatl start = select_lanes(mirrored, line.to, line.from), minor_start = line.minor_0 + line.tilt * start;
    const intl enters = (line.from > line.to) | (start < 0.0f) | (start > line.last_major) | (minor_start < 0.0f) |
                        (minor_start > last_minor); /* mask: the line enters the image at its border */
    const float side = group.side, guard = 5e-7f * (map.dst_width + map.dst_height);
    const int spare = map.dst_height * map.dst_pitch + packet * LANES;
    /* If the column's surface lies behind the target's centre, all rays that recede from the source are farther from it
     * than the surface, and all rays that approach it are nearer. */
    const intl all_free = map.dst_from_src[11] > 0.0f ? -1 : 0;

#if ALIGNED
    const intl first_at = to_intl(clamp_lanes(line.minor_0, (floatl)0.0f, last_minor) + 0.5f) * line.stride_minor;
#endif
    floatl steps = select_lanes(line.from > line.to, (floatl)-1.0f, last - first), major = select_lanes(mirrored, first, last), ahead = NO_SURFACE;
    floatl pixel = side > 0.0f ? line.low : line.high;
    intl after = CLASS_OUTSIDE; /* class of rays whose last free place is this column: from the column walked before */
    for (intl there = steps >= 0.0f;; there = steps >= 0.0f) {
        const intl untold = (pixel >= line.low) & (pixel <= line.high);
        if (!any_lane(untold))
            return;
        const floatl on_line = clamp_lanes(major, line.from, line.to), column = clamp_lanes(on_line, (floatl)0.0f, line.last_major);
#if ALIGNED
        const intl at = first_at + to_intl(column + 0.5f) * line.stride_major;
#else
        const floatl row = clamp_lanes(line.minor_0 + line.tilt * on_line, (floatl)0.0f, last_minor);
        const intl at = to_intl(column + 0.5f) * line.stride_major + to_intl(row + 0.5f) * line.stride_minor;
#endif
        const floatl here = (floatl)(gather(grid.nearness, at));
        const intl missing = here <= NO_SURFACE;
        const Projection place = project_at(targets, on_line, select_lanes(missing, (floatl)nearest, here));
        const floatl seen = side * place.p, per_pixel = side * place.w;
        const intl before = place.w > 0.0f;
        const intl tells = untold & (!there | select_lanes(before, seen > pixel * per_pixel, all_free));
        if (any_lane(tells)) {
            const intl meets = there & (after == CLASS_HIDDEN) & (fabs(here - ahead) < ONE_SURFACE * fabs(here));
            const intl class_ = select_lanes(there | !enters, after, (intl)CLASS_OUTSIDE);
            floatl value = as_floatl(class_);
            if (any_lane(tells & meets))
                value = select_lanes(meets, place.q / place.w, value);
            const intl address = owned_pixel(line, group, map, pixel, tells, spare, guard);
#if LANES == 1
            told[address] = value;
#else
            EACH_LANE(TELL_LANE)
#endif
            pixel += select_lanes(tells, (floatl)side, (floatl)0.0f);
        }
        const intl again = (pixel >= line.low) & (pixel <= line.high) & select_lanes(before, seen > pixel * per_pixel, all_free);
        const intl passes = there & !again;
        ahead = select_lanes(passes, here, ahead);
        after = select_lanes(passes, select_lanes(missing, (intl)CLASS_UNOBSERVED, (intl)CLASS_HIDDEN), after);
        major -= select_lanes(passes, line.sign, (floatl)0.0f);
        steps -= select_lanes(passes, (floatl)1.0f, (floatl)0.0f);
    }
}

kernel void classify_lines(global const float *surface, global float *told, global const LineGroup *groups,
                           int group_count, int packet_count, PixelMap map, float nearest)
{
    const int packet = get_global_id(0);
    if (packet >= packet_count)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    tell_packet(grid, told, groups[group_of(groups, group_count, packet)], packet, map, nearest);
}

/* The classes of pixels, from the source's samples where the pixels' rays have the target nearness `near` */
INLINED intl class_in_place(Grid grid, Rays rays, floatl near)
{
    const floatl w = rays.w + near * rays.centre.z;
    const floatl u = (rays.u + near * rays.centre.x) / w, v = (rays.v + near * rays.centre.y) / w;
    const floatl last_u = grid.width - 1, last_v = grid.height - 1;
    const intl inside = (w > 0.0f) & (u >= -BORDER) & (v >= -BORDER) & (u <= last_u + BORDER) & (v <= last_v + BORDER);
    const intl x = to_intl(clamp_lanes(u, (floatl)0.0f, last_u) + 0.5f), y = to_intl(clamp_lanes(v, (floatl)0.0f, last_v) + 0.5f);
    const intl missing = (floatl)(gather(grid.nearness, y * grid.pitch + x)) <= NO_SURFACE;
    return select_lanes(inside, select_lanes(missing, (intl)CLASS_UNOBSERVED, (intl)CLASS_HIDDEN), (intl)CLASS_OUTSIDE);
}

kernel void classify(global const float *surface, global const float *told, global const uchar *valid,
                     global uchar *classes, PixelMap map)
{
    const int low_x = get_global_id(0) * (STRIP * LANES), high_x = min(low_x + STRIP * LANES, map.dst_width);
    const int y = get_global_id(1);
    if (low_x >= map.dst_width || y >= map.dst_height)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    valid += (size_t)y * map.dst_width;
    classes += (size_t)y * map.dst_width;
    told += (size_t)y * map.dst_pitch;
    const int below = y + 1 < map.dst_height ? map.dst_pitch : 0;
    for (int x = low_x; x < high_x; x += LANES) {
        const int count = min(LANES, high_x - x);
        const intl known = select_lanes(load_first_bytes(valid + x, count, 0) != 0, (intl)CLASS_SEEN,
                                        load_first_bytes(classes + x, count, CLASS_SEEN));
        intl class_ = known;
        if (any_lane(known > CLASS_HIDDEN)) {
            const intl own = as_intl(load_lanes(told + x)), right = as_intl(load_lanes(told + x + 1));
            const intl beside = select_lanes(right != 0, right, as_intl(load_lanes(told + x + below)));
            class_ = select_lanes(own != 0, own, beside);
            const intl placed = (class_ <= 0) | (class_ > CLASS_OUTSIDE);
            if (any_lane(placed))
                class_ = select_lanes(placed, class_in_place(grid, rays_of(map, to_floatl(x + lane_index), (floatl)y), as_floatl(class_)), class_);
            class_ = min(class_, known);
        }
        store_first_bytes(class_, classes + x, count);
    }
}
