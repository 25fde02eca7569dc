/* Why a pixel of the target is a hole: what its ray passes through, as far as the source shows.
 *
 * A ray is followed along its epipolar line as it recedes. Where it is nearer than the surface, the source has seen
 * that there is nothing. So the pixel shows something beyond the last such place, and its class is that of what begins
 * there: space behind a surface, samples without depth, or the outside of the image. A ray that comes out of a
 * surface's back ends there.
 *
 * Most of what a ray passes lies wholly before it or wholly behind it. How near and how far the surface is within windows of
 * its samples (lib/bounds.h) tells that, window by window; and the class, too, where all samples that it may depend on are
 * there. The other rays, gathered to full packets, look at the samples themselves in the windows that tell too little.
 *
 * valid: (dst_height, dst_width). classes: the same shape, CLASS_... below; with `first` 0 they hold those of other
 * views, and the least of both stays. nearest, farthest: the source's range of nearness. without_parallax: nothing
 * moves with its depth, each pixel sees its place in the source; typical: some nearness that it has there.
 * Work-item: STRIP * LANES pixels of a row. Cost: O(windows between the nearest and the farthest place of the ray) a hole,
 * O(samples) at worst. Determinism: every pixel on its own.
 */
#include "lib/bounds.h"
#include "warp/trace.h"

#ifndef STRIP
#define STRIP 1 /* packets of a row that a work-item classifies: starting one takes longer than most */
#endif

/* Of several views' classes the least counts. */
#define CLASS_SEEN 0
#define CLASS_HIDDEN 1     /* by something nearer */
#define CLASS_UNOBSERVED 2 /* no depth there */
#define CLASS_OUTSIDE 3    /* of the source's image */
#define IS_FREE 4          /* nothing there, while the ray is followed */

/* The state of rays of nearness `near` at places of the source's image: IS_FREE or a class. Sets whether the surface is
 * closed there. */
INLINED intl state_at(Grid grid, floatl u, floatl v, floatl near, intl *closed)
{
    const floatl uc = clamp_lanes(floor_lanes(u), (floatl)-1.0f, (floatl)(grid.width - 1));
    const floatl vc = clamp_lanes(floor_lanes(v), (floatl)-1.0f, (floatl)(grid.height - 1));
    const floatl fu = u - uc, fv = v - vc;
    const intl upper = fu + fv > 1.0f;
    floatl corners[4];
    gather_cells(grid.nearness, grid.pitch, to_intl(vc) * grid.pitch + to_intl(uc), corners);
    const floatl q10 = corners[1], q01 = corners[2], qc = select_lanes(upper, corners[3], corners[0]);
    const floatl qn = select_lanes(fv > 0.5f, select_lanes(fu > 0.5f, corners[3], q01), select_lanes(fu > 0.5f, q10, corners[0]));
    *closed = !select_lanes(upper, IS_UPPER_OPEN(corners[0], q10, q01), IS_LOWER_OPEN(corners[0]));
    const floatl gu = select_lanes(upper, qc - q01, q10 - qc), gv = select_lanes(upper, qc - q10, q01 - qc);
    const floatl one = select_lanes(upper, (floatl)1.0f, (floatl)0.0f);
    const floatl surface = select_lanes(*closed, qc + gu * (fu - one) + gv * (fv - one), qn);
    return select_lanes(surface <= NO_SURFACE, (intl)CLASS_UNOBSERVED,
                        select_lanes(surface < near, (intl)IS_FREE, (intl)CLASS_HIDDEN));
}

/* Where nothing moves with its depth, each pixel has one place in the source. */
INLINED intl class_in_place(Grid grid, Rays rays, float typical)
{
    const floatl w = rays.w + typical * rays.centre.z;
    const floatl u = (rays.u + typical * rays.centre.x) / w, v = (rays.v + typical * rays.centre.y) / w;
    const intl inside = (w > 0.0f) & (u >= -BORDER) & (v >= -BORDER) & (u <= grid.width - 1.0f + BORDER) & (v <= grid.height - 1.0f + BORDER);
    intl closed;
    const intl state = state_at(grid, clamp_lanes(u, (floatl)-BORDER, (floatl)grid.width),
                                clamp_lanes(v, (floatl)-BORDER, (floatl)grid.height), (floatl)INFINITY, &closed);
    return select_lanes(inside, select_lanes(state == CLASS_UNOBSERVED, state, (intl)CLASS_HIDDEN), (intl)CLASS_OUTSIDE);
}

#define FROM_RING 0.99f /* from samples to those of the ring; less by what rounding may do, for which windows have room */
#define STEP_ROUNDING 0.01f

/* Rays along their lines, in steps of a sample */
typedef struct {
    Epipolar epipolar;
    floatl start, end; /* distances along the lines */
    floatl steps;      /* that reach the end; < 0: there are none to take */
    floatl per_near;   /* steps that change nearness by 1 */
    intl class_;       /* before the first one */
    intl leaves;       /* the image, before it is hidden */
} Walk;

INLINED Walk walk_of(Grid grid, Rays rays, float nearest, float farthest, intl wanted)
{
    Walk walk;
    walk.epipolar = epipolar_of(rays, grid);
    const Lines lines = walk.epipolar.lines;
    const floatl near = walk.epipolar.near, near_step = walk.epipolar.near_step;
    /* A ray that recedes from the source, too, is free before the nearest sample's depth and hidden behind the farthest
     * one's: between these it is followed. One that comes towards the source is followed from the farthest one's depth to
     * the end. */
    const intl falls = near_step < 0.0f, rises = near_step > 0.0f;
    const floatl to_nearest = (nearest - near) / near_step, to_farthest = (farthest - near) / near_step;
    const floatl from = select_lanes(falls, to_nearest, select_lanes(rises, to_farthest, (floatl)0.0f));
    const floatl to = select_lanes(falls, to_farthest, lines.length);
    walk.start = clamp_lanes(from, (floatl)0.0f, fmax(lines.length, (floatl)0.0f));
    walk.end = clamp_lanes(to, walk.start, lines.length);
    walk.leaves = !(to < lines.length);
    const intl enters = (lines.u < 0.0f) | (lines.v < 0.0f) | (lines.u > grid.width - 1.0f) | (lines.v > grid.height - 1.0f);
    const intl before = select_lanes(falls, (intl)IS_FREE, (intl)CLASS_HIDDEN);
    const intl at_border = select_lanes(enters, (intl)CLASS_OUTSIDE, (intl)IS_FREE);
    walk.class_ = select_lanes(from > 0.0f, before, at_border);
    const floatl length = clamp_lanes(walk.end - walk.start, (floatl)0.0f, (floatl)(max(grid.width, grid.height) + 2));
    walk.steps = select_lanes(wanted & (lines.length >= 0.0f), ceil_lanes(length), (floatl)-1.0f);
    walk.per_near = 1.0f / near_step;
    return walk;
}

/* The class at the end of walks */
INLINED intl class_at_end(Walk walk, intl class_)
{
    const intl beyond = select_lanes(walk.leaves, (intl)CLASS_OUTSIDE, (intl)CLASS_HIDDEN);
    return select_lanes(walk.epipolar.lines.length >= 0.0f, select_lanes(class_ == IS_FREE, beyond, class_),
                        (intl)CLASS_OUTSIDE);
}

/* The samples around BOUNDS_STEP steps of walks */
typedef struct {
    floatl low, high;    /* nearness of those that are there */
    floatl near;         /* of the rays at the first step */
    intl before, behind; /* the rays pass all of them so; both, if there are none */
    intl whole;          /* none is missing */
} Window;

INLINED Window window_at(Grid grid, global const float *bounds, Walk walk, floatl step)
{
    const Lines lines = walk.epipolar.lines;
    const floatl from = min_lanes(walk.start + step, walk.end);
    const floatl to = min_lanes(walk.start + step + (BOUNDS_STEP - 1.0f), walk.end);
    const floatl u = lines.u + min_lanes(lines.du * from, lines.du * to);
    const floatl v = lines.v + min_lanes(lines.dv * from, lines.dv * to);
    const intl x = to_intl(clamp_lanes(u + FROM_RING, (floatl)0.0f, (floatl)grid.width)) / BOUNDS_STEP;
    const intl y = to_intl(clamp_lanes(v + FROM_RING, (floatl)0.0f, (floatl)grid.height)) / BOUNDS_STEP;
    Window window;
    gather_pairs(bounds, 2 * (y * BOUNDS_ACROSS(grid.width) + x), &window.low, &window.high);
    window.near = walk.epipolar.near + walk.epipolar.near_step * from;
    const floatl near_to = walk.epipolar.near + walk.epipolar.near_step * to;
    window.before = window.high < min_lanes(window.near, near_to);
    window.behind = window.low >= max_lanes(window.near, near_to);
    window.whole = (as_intl(window.high) & SOME_MISSING) == 0;
    return window;
}

/* The classes that windows tell by themselves; CLASS_SEEN where they do not: what a ray's class may be after each of them,
 * whatever its samples are. */
INLINED intl class_by_windows(Grid grid, global const float *bounds, Walk walk)
{
    intl free = walk.class_ == IS_FREE, hidden = walk.class_ == CLASS_HIDDEN, outside = walk.class_ == CLASS_OUTSIDE;
    intl unobserved = 0, emerges = 0;
    for (floatl step = 0.0f; any_lane(step <= walk.steps); step += (float)BOUNDS_STEP) {
        const Window window = window_at(grid, bounds, walk, step);
        const intl beyond = step > walk.steps, may_free = !window.behind, may_hidden = !window.before;
        const intl begins = (!beyond) & (free | may_free), stays = beyond | !window.whole | may_hidden;
        emerges = emerges | ((!beyond) & may_free & (hidden | may_hidden));
        hidden = (hidden & stays) | (begins & may_hidden);
        unobserved = (unobserved & stays) | (begins & !window.whole);
        outside = outside & stays;
        free = select_lanes(beyond, free, may_free);
    }
    hidden = hidden | emerges | (free & !walk.leaves);
    outside = outside | (free & walk.leaves);
    const intl only_outside = outside & !(hidden | unobserved), only_unobserved = unobserved & !(hidden | outside);
    const intl only_hidden = hidden & !(unobserved | outside);
    const intl told = select_lanes(only_hidden, (intl)CLASS_HIDDEN, select_lanes(only_unobserved, (intl)CLASS_UNOBSERVED, (intl)CLASS_SEEN));
    return select_lanes(only_outside | (walk.steps < 0.0f), (intl)CLASS_OUTSIDE, told);
}

/* A part of walks: from the first step to the last one; from there on to the first free place at `most` */
typedef struct {
    floatl first, last, most;
} Part;

/* The next part of walks whose samples must be looked at, from a step on; there is none if it begins beyond the end. What a
 * free ray passes before all samples of a window leaves it free, but for the last place, where a sample may be missing;
 * what another one passes behind them changes nothing, but for whether the surface is closed at the last place. */
INLINED Part next_part(Grid grid, global const float *bounds, Walk walk, floatl next, intl class_, intl wanted)
{
    const floatl none = 0.0f, all = BOUNDS_STEP;
    const intl falls = walk.per_near < 0.0f, rises = walk.per_near > 0.0f, is_free = class_ == IS_FREE;
    Part part = {walk.steps + select_lanes(is_free, none, (floatl)1.0f), walk.steps, walk.steps};
    intl begun = !wanted, open_ = wanted;
    for (floatl step = next; any_lane(open_ & (step <= walk.steps)); step += all) {
        const Window window = window_at(grid, bounds, walk, step);
        /* Steps to where the ray is as far as the nearest sample, and as the farthest one */
        const floatl to_high = clamp_lanes((window.high - window.near) * walk.per_near, none, all);
        const floatl to_low = clamp_lanes((window.low - window.near) * walk.per_near, none, all);
        const intl within = open_ & (step <= walk.steps);
        const intl begins = within & !begun & !select_lanes(is_free, window.before, window.behind);
        const floatl same = select_lanes(is_free, select_lanes(falls, to_high, none), select_lanes(rises, to_low, none));
        const floatl first = step + truncated(max_lanes(same - STEP_ROUNDING, none)) - 1.0f;
        part.first = select_lanes(begins, max_lanes(first, next), part.first);
        begun = begun | begins;
        const floatl mixed = select_lanes(falls, to_low, select_lanes(rises, to_high, all));
        const floatl looked = select_lanes(window.before | window.behind, none, mixed);
        const intl ends = within & begun & (looked < all - STEP_ROUNDING);
        part.last = select_lanes(ends, step + ceil_lanes(looked + STEP_ROUNDING), part.last);
        part.most = select_lanes(ends, select_lanes(window.before, step + (all - 1.0f), part.last), part.most);
        open_ = open_ & !ends;
    }
    part.last = min_lanes(part.last, walk.steps);
    part.most = min_lanes(part.most, walk.steps);
    return part;
}

/* The same classes, by samples, of all rays that take steps */
INLINED intl class_by_samples(Grid grid, global const float *bounds, Walk walk)
{
    const Epipolar epipolar = walk.epipolar;
    const Lines lines = epipolar.lines;
    intl class_ = walk.class_, was_closed = 0, active = walk.steps >= 0.0f;
    floatl next = 0.0f;
    for (int parts_left = max(grid.width, grid.height) + 4; parts_left > 0 && any_lane(active); parts_left--) {
        const Part part = next_part(grid, bounds, walk, next, class_, active);
        active = active & (part.first <= walk.steps);
        intl walks = active;
        for (floatl step = part.first; any_lane(walks); step += 1.0f) {
            const floatl here = min_lanes(walk.start + step, walk.end);
            const floatl u = lines.u + lines.du * here, v = lines.v + lines.dv * here;
            intl closed;
            const intl state = state_at(grid, u, v, epipolar.near + epipolar.near_step * here, &closed);
            const intl is_free = state == IS_FREE;
            const intl emerges = walks & is_free & (class_ == CLASS_HIDDEN) & was_closed & closed;
            class_ = select_lanes(walks & !emerges & (is_free | (class_ == IS_FREE)), state, class_);
            was_closed = select_lanes(walks, closed, was_closed);
            active = active & !emerges;
            next = select_lanes(walks, step + 1.0f, next);
            walks = walks & !emerges & ((step < part.last) | (!is_free & (step < part.most)));
        }
        active = active & (next <= walk.steps);
    }
    return class_at_end(walk, class_);
}

/* Which of a packet of pixels the view may tell something of: holes, and of those that other views have told of already
 * the ones that may be less. Of the `first` view, the others are seen. */
INLINED intl holes_at(global const uchar *valid, global uchar *classes, int count, int first)
{
    intl seen = 1, told = CLASS_OUTSIDE;
    if (count >= LANES) {
        seen = load_bytes(valid);
        if (first)
            store_bytes(to_ucharl((intl)CLASS_SEEN), classes);
        else
            told = load_bytes(classes);
    } else {
        for (int lane = 0; lane < count; lane++) {
            set_int_lane(seen, lane, valid[lane]);
            if (first)
                classes[lane] = CLASS_SEEN;
            else
                set_int_lane(told, lane, classes[lane]);
        }
    }
    return (seen == 0) & (told > CLASS_HIDDEN);
}

/* Adds those of LANES pixels that are wanted to `count` others; there is room for LANES more. Returns how many are now. */
INLINED int add_pixels(int *chosen, int count, intl pixels, intl wanted)
{
    if (any_lane(wanted))
        for (int lane = 0; lane < LANES; lane++) {
            chosen[count] = int_lane(pixels, lane);
            count += int_lane(wanted, lane) != 0;
        }
    return count;
}

INLINED void write_classes(const int *pixels, int count, intl class_, int first, global uchar *classes)
{
    for (int lane = 0; lane < min(count, LANES); lane++) {
        const uchar one = int_lane(class_, lane);
        classes[pixels[lane]] = first ? one : min(one, classes[pixels[lane]]);
    }
}

kernel void classify(global const float *surface, global const float *bounds, global const uchar *valid,
                     global uchar *classes, PixelMap map, float nearest, float farthest, float typical,
                     int without_parallax, int first)
{
    const int low_x = get_global_id(0) * (STRIP * LANES), high_x = min(low_x + STRIP * LANES, map.dst_width);
    const int y = get_global_id(1);
    if (low_x >= map.dst_width || y >= map.dst_height)
        return;
    valid += (size_t)y * map.dst_width;
    classes += (size_t)y * map.dst_width;
    int holes[(STRIP + 1) * LANES], untold[(STRIP + 1) * LANES], hole_count = 0, untold_count = 0;
    for (int x = low_x; x < high_x; x += LANES) {
        const intl wanted = holes_at(valid + x, classes + x, min(LANES, high_x - x), first);
        hole_count = add_pixels(holes, hole_count, x + lane_index, wanted);
    }

    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    for (int hole = 0; hole < hole_count; hole += LANES) {
        const intl wanted = hole + lane_index < hole_count;
        const intl x = select_lanes(wanted, (intl)load_lanes(holes + hole), (intl)low_x);
        const Rays rays = rays_of(map, to_floatl(x), y);
        const intl class_ = without_parallax
                                ? class_in_place(grid, rays, typical)
                                : class_by_windows(grid, bounds, walk_of(grid, rays, nearest, farthest, wanted));
        const intl told = class_ != CLASS_SEEN;
        write_classes(holes + hole, hole_count - hole, select_lanes(told, class_, (intl)CLASS_OUTSIDE), first, classes);
        untold_count = add_pixels(untold, untold_count, x, wanted & !told);
    }
    for (int hole = 0; hole < untold_count; hole += LANES) {
        const intl wanted = hole + lane_index < untold_count;
        const intl x = select_lanes(wanted, (intl)load_lanes(untold + hole), (intl)low_x);
        const Walk walk = walk_of(grid, rays_of(map, to_floatl(x), y), nearest, farthest, wanted);
        write_classes(untold + hole, untold_count - hole, class_by_samples(grid, bounds, walk), first, classes);
    }
}
