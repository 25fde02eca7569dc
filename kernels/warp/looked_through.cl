/* Removes margins and uncertain bridges of a view's surface where a ray of another view passes through them.
 *
 * At edges, a view extends its surface by half a sample (margins, lib/margins.h). Where a steep surface seems to
 * continue, the view connects neighbours that differ by more than step_allowed (bridges). None of this was seen. If a
 * ray of another view passes such a place and goes on, the place is empty. So these places are listed as points, and
 * each view tests the points of all other views.
 *
 * A point's depth is only known within its noise. So a point is a piece of its view's ray, and another view must look
 * through both ends and the middle of this piece. The other view's nearest ray must pass within half a sample of the
 * point (in samples of the point's view), since coarse views do not show details. The ray must be known to meet
 * nothing, or must meet the other view's surface farther behind the point than noise and a fraction of a sample
 * explain. Objects one sample thin consist of margins alone, so their margins stay.
 *
 * points: (POINT_PLANES, pitch), one point per column; a view's columns are adjacent. seen: (pitch,) 1 if another view
 * has looked through the point. surface: picture/edges.cl; nearness: picture/nearness.cl, with the same pitch.
 * Launches: find_bridges twice for each view, to count the bridges and to list them; look_through for each view;
 * tear_bridges; then list_margins, look_through and keep_margins. Work-item: a piece of a row (find_bridges); one
 * column (tear_bridges); `share` columns (keep_margins); STRIP * LANES columns (the others). Cost: O(samples + points *
 * views). Determinism: results do not depend on the order of a view's points.
 */
#include "lib/lanes.h"
#include "lib/margins.h"
#include "lib/surface.h"
#include "lib/vectors.h"
#include "warp/view_edges.h"

#define ENDS 0   /* six planes: the piece's two ends in the world, relative to the set's origin */
#define POINT_REACH 6  /* scene units: half a sample of the point's view; negative: the point is not tested */
#define BRIDGE 7 /* an int: the index of the bridge's sample in `surface`, times 8, plus its TORN_... bit */
#define POINT_PLANES 8

#define POINT_ASIDE 0.3f /* samples from a margin's sample to its point, which is slightly beyond the margin's middle */
#define OWN_DEVIATIONS 4.0f  /* half the length of a point's piece of ray, in standard deviations of the noise */
#define SEEN_DEVIATIONS 6.0f /* a point must lie in front of a surface by more than this many deviations, */
#define SURFACE_TOLERANCE 0.2f /* and by more than this fraction of a sample, since surfaces bend between samples */

/* A view of the set. At depth z, its noise has the standard deviation noise_2 z z + noise_1 z + noise_0. */
typedef struct {
    float pixel_from_world[16], world_from_pixel[16];
    int width, height, pitch, perspective;
    float sample; /* side of a pixel in scene units: at depth 1 (perspective), at all depths (orthographic) */
    float noise_2, noise_1, noise_0;
} SetView;

#define VIEW_NOISE(view, z) (((view).noise_2 * (z) + (view).noise_1) * (z) + (view).noise_0)
#define SAMPLE_AT(view, z) (((view).perspective ? (z) : (floatl)1.0f) * (view).sample)
#define GRID_OF_VIEW(surface, view) GRID_OF(surface, (view).width, (view).height, (view).pitch, NO_CUT)
#define SAMPLES_AT(values, place) (floatl)(gather(values, place))

typedef struct {
    floatl planes[POINT_PLANES - 1];
} Points;

/* The points of pixels (x, y) at nearness n */
INLINED Points points_at(SetView view, floatl x, floatl y, floatl n)
{
    const floatl z = DEPTH_OF(view.perspective, n), noise = OWN_DEVIATIONS * VIEW_NOISE(view, z);
    const float *m = view.world_from_pixel;
    Points points;
    UNROLLED
    for (int end = 0; end < 2; end++) {
        const floatl nearest = view.perspective ? 0.5f * z : z - noise;
        const floatl deep = end ? z + noise : max_lanes(z - noise, nearest);
        const floatl at = DEPTH_OF(view.perspective, deep), inverse = 1.0f / MAP_ROW(m, 3, x, y, at);
        UNROLLED
        for (int axis = 0; axis < 3; axis++)
            points.planes[ENDS + 3 * end + axis] = MAP_ROW(m, axis, x, y, at) * inverse;
    }
    points.planes[POINT_REACH] = 0.5f * SAMPLE_AT(view, z);
    return points;
}

/* Returns the number of uncertain bridges of samples `first` to `end` - 1 of a row. Unless `points` is 0, also writes
 * the bridges to its columns from `at` on. */
OUTLINED int bridges_of(Grid grid, SetView view, EdgeView steps, int first, int end, int y, global float *points, int at,
                        int point_pitch)
{
    int count = 0;
    for (int x0 = first; x0 < end; x0 += LANES) {
        global const float *own = grid.nearness + (size_t)y * grid.pitch + x0;
        const intl x = x0 + lane_index, has_right = x + 1 < grid.width, has_below = y + 1 < grid.height ? -1 : 0;
        const floatl here = load_lanes(own), right = load_lanes(own + 1), below = load_lanes(own + grid.pitch);
        for (int number = 0; number < 3; number++) { /* edges to the right, downwards, and along the diagonal */
            const floatl a = number == 2 ? right : here, b = number == 0 ? right : below;
            const intl inside = (x < end) & (number == 1 ? (intl)-1 : has_right) & (number == 0 ? (intl)-1 : has_below);
            const intl is_torn = (as_intl(here) & (TORN_RIGHT << number)) != 0;
            const floatl z = DEPTH_OF(view.perspective, max_lanes(a, b)), far = DEPTH_OF(view.perspective, min_lanes(a, b));
            uint left = lane_bits(inside & !is_torn & (far - z > step_allowed(steps, z)));
            if (!left)
                continue;
            count += popcount(left);
            if (!points)
                continue;
            const floatl middle = 0.5f * (a + b), aside = number == 1 ? 0.0f : 0.5f, under = number == 0 ? 0.0f : 0.5f;
            const Points found = points_at(view, to_floatl(x) + aside, (floatl)(under + y), middle);
            for (; left; left = WITHOUT_LOWEST(left), at++) {
                const int lane = LOWEST(left), place = (y + 1) * grid.pitch + 1 + x0 + lane;
                for (int plane = 0; plane < POINT_PLANES - 1; plane++)
                    points[plane * (size_t)point_pitch + at] = float_lane(found.planes[plane], lane);
                points[BRIDGE * (size_t)point_pitch + at] = as_float(place * (TORN_ALL + 1) | TORN_RIGHT << number);
            }
        }
    }
    return count;
}

/* count: the number of bridges of each view, initially 0. lists: 1 if the bridges are also listed, from column `start`
 * on */
kernel void find_bridges(global const float *surface, SetView view, EdgeView steps, global int *count, int number,
                         int piece, int lists, global float *points, int start, int point_pitch)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1), end = min(first + piece, view.width);
    if (first >= view.width || y >= view.height)
        return;
    const Grid grid = GRID_OF_VIEW(surface, view);
    const int own = bridges_of(grid, view, steps, first, end, y, 0, 0, 0);
    if (!own)
        return;
    const int at = atomic_add((volatile global int *)(count + number), own);
    if (lists)
        bridges_of(grid, view, steps, first, end, y, points, start + at, point_pitch);
}

/* Is a cell whole, given its first sample and the samples to the right of it and below it? */
#define IS_WHOLE_CELL(first, right, below) ((!IS_LOWER_OPEN(first)) & (!IS_UPPER_OPEN(first, right, below)))

/* The mask of the samples (x, y) that are a corner of a whole cell. The surface is one sample thin at the others. */
INLINED intl in_cell(Grid grid, intl x, intl y)
{
    const intl at = y * grid.pitch + x, above = at - grid.pitch, below = at + grid.pitch;
    const floatl here = SAMPLES_AT(grid.nearness, at);
    const floatl left = SAMPLES_AT(grid.nearness, at - 1), right = SAMPLES_AT(grid.nearness, at + 1);
    const floatl up = SAMPLES_AT(grid.nearness, above), down = SAMPLES_AT(grid.nearness, below);
    const floatl up_left = SAMPLES_AT(grid.nearness, above - 1), up_right = SAMPLES_AT(grid.nearness, above + 1);
    const floatl down_left = SAMPLES_AT(grid.nearness, below - 1);
    return IS_WHOLE_CELL(here, right, down) | IS_WHOLE_CELL(left, here, down_left) | IS_WHOLE_CELL(up, up_right, here) |
           IS_WHOLE_CELL(up_left, up, left);
}

/* The points of a packet of margins */
INLINED Points points_of_margins(Grid grid, SetView view, global const float *margins, size_t pitch, intl inside)
{
    const intl bits = as_intl(load_lanes(margins + MARGIN_BITS * pitch));
    const floatl x = load_lanes(margins + MARGIN_X * pitch), y = load_lanes(margins + MARGIN_Y * pitch);
    const intl to_right = (bits & TO_RIGHT) != 0, to_below = (bits & TO_BELOW) != 0;
    /* If only half of a quarter is a margin, the middle of this half is nearer to the sample's row or to its column. */
    const intl is_half = ((bits & IN_LOWER) != 0) ^ ((bits & IN_UPPER) != 0);
    const intl is_flat = is_half & (to_right ^ ((bits & IN_LOWER) != 0)), is_high = is_half & !is_flat;
    const floatl much = 1.15f * POINT_ASIDE, little = 0.5f * POINT_ASIDE, even = POINT_ASIDE;
    const floatl aside_x = select_lanes(is_flat, much, select_lanes(is_high, little, even));
    const floatl aside_y = select_lanes(is_high, much, select_lanes(is_flat, little, even));
    const floatl dx = select_lanes(to_right, aside_x, -aside_x), dy = select_lanes(to_below, aside_y, -aside_y);
    const floatl n = load_lanes(margins + MARGIN_NEARNESS * pitch) + dx * load_lanes(margins + MARGIN_SLOPE_X * pitch) +
                     dy * load_lanes(margins + MARGIN_SLOPE_Y * pitch);
    Points points = points_at(view, x + dx, y + dy, n);
    const intl first = 0;
    const intl is_shown = in_cell(grid, select_lanes(inside, to_intl(x), first), select_lanes(inside, to_intl(y), first));
    points.planes[POINT_REACH] = select_lanes(is_shown, points.planes[POINT_REACH], (floatl)-1.0f);
    return points;
}

/* Writes the points of a view's `count` margins to the columns from `start` on. May also write LANES further columns,
 * which later views overwrite. surface: as it was before bridges were torn */
kernel void list_margins(global const float *surface, SetView view, global const float *margins, int count, int pitch,
                         global float *points, int start, int point_pitch)
{
    const Grid grid = GRID_OF_VIEW(surface, view);
    const int first = get_global_id(0) * STRIP * LANES;
    for (int i = first; i < min(first + STRIP * LANES, count); i += LANES) {
        const Points found = points_of_margins(grid, view, margins + i, pitch, i + lane_index < count);
        for (int plane = 0; plane < POINT_PLANES - 1; plane++)
            store_lanes(found.planes[plane], points + plane * (size_t)point_pitch + start + i);
    }
}

/* The mask of points p that a view looks through: its nearest ray passes p within `reach`, and goes on behind p */
INLINED intl looks_beyond(Grid grid, SetView view, global const float *nearness, Vector p, floatl reach)
{
    const float *m = view.pixel_from_world;
    const floatl w = POINT_ROW(m, 2, p), inverse = 1.0f / w;
    const floatl u = POINT_ROW(m, 0, p) * inverse, v = POINT_ROW(m, 1, p) * inverse, n = POINT_ROW(m, 3, p) * inverse;
    const intl inside = (w > 0.0f) & IS_BEFORE(view.perspective, n) & (u > -BORDER) & (v > -BORDER) &
                        (u < grid.width - BORDER) & (v < grid.height - BORDER);
    if (!any_lane(inside))
        return 0;
    const floatl x = floor_lanes(clamp_lanes(u + 0.5f, (floatl)0.0f, (floatl)(grid.width - 1)));
    const floatl y = floor_lanes(clamp_lanes(v + 0.5f, (floatl)0.0f, (floatl)(grid.height - 1)));
    const intl to_right = u > x, to_below = v > y, step_x = select_lanes(to_right, (intl)1, (intl)-1);
    const intl step_y = select_lanes(to_below, (intl)grid.pitch, (intl)-grid.pitch), at = to_intl(y) * grid.pitch + to_intl(x);
    const floatl here = SAMPLES_AT(grid.nearness, at), beside = SAMPLES_AT(grid.nearness, at + step_x);
    const floatl next = SAMPLES_AT(grid.nearness, at + step_y); /* above or below */
    const intl torn_beside = (as_intl(select_lanes(to_right, here, beside)) & TORN_RIGHT) != 0;
    const intl torn_next = (as_intl(select_lanes(to_below, here, next)) & TORN_BELOW) != 0;
    const floatl off_x = fabs(u - x), off_y = fabs(v - y), none = 0.0f;
    const floatl surface = here + select_lanes(torn_beside, none, off_x * (beside - here)) +
                           select_lanes(torn_next, none, off_y * (next - here));
    const floatl z = DEPTH_OF(view.perspective, n), sample = SAMPLE_AT(view, z);
    const floatl allowed = max_lanes(SURFACE_TOLERANCE * sample, SEEN_DEVIATIONS * VIEW_NOISE(view, z));
    const intl farther = DEPTH_OF(view.perspective, surface) > z + allowed;
    const intl is_free = SAMPLES_AT(nearness, at) < NO_SURFACE;
    return inside & (max_lanes(off_x, off_y) * sample <= reach) & select_lanes(here > NO_SURFACE, farther, is_free);
}

/* Tests all points except the view's own points, in columns `own_first` to `own_end` - 1. */
kernel void look_through(global const float *points, global uchar *seen, global const float *surface,
                         global const float *nearness, SetView view, int count, int pitch, int own_first, int own_end)
{
    const Grid grid = GRID_OF_VIEW(surface, view);
    const int first = get_global_id(0) * STRIP * LANES;
    for (int i = first; i < min(first + STRIP * LANES, count); i += LANES) {
        const intl column = i + lane_index;
        const intl others = (column < count) & ((column < own_first) | (column >= own_end));
        intl through = others & (load_bytes(seen + i) == 0);
        const floatl reach = load_lanes(points + POINT_REACH * (size_t)pitch + i);
        Vector ends[2];
        for (int end = 0; end < 2; end++) {
            global const float *from = points + (ENDS + 3 * end) * (size_t)pitch + i;
            ends[end].x = load_lanes(from);
            ends[end].y = load_lanes(from + pitch);
            ends[end].z = load_lanes(from + 2 * (size_t)pitch);
        }
        for (int part = 0; part < 3 && any_lane(through); part++) {
            const float b = 0.5f * part, a = 1.0f - b;
            const Vector p = {a * ends[0].x + b * ends[1].x, a * ends[0].y + b * ends[1].y, a * ends[0].z + b * ends[1].z};
            through = through & looks_beyond(grid, view, nearness, p, reach);
            if (!any_lane((ends[0].x != ends[1].x) | (ends[0].y != ends[1].y) | (ends[0].z != ends[1].z)))
                break; /* without noise, the parts are one point */
        }
        for (uint left = lane_bits(through); left; left = WITHOUT_LOWEST(left))
            seen[i + LOWEST(left)] = 1;
    }
}

/* Tears those bridges in columns `first` to `end` - 1 that were looked through. */
kernel void tear_bridges(global const float *points, global const uchar *seen, global float *surface, int first, int end,
                         int pitch)
{
    const int i = first + get_global_id(0);
    if (i >= end || !seen[i])
        return;
    const int bridge = as_int(points[BRIDGE * (size_t)pitch + i]);
    atomic_or((volatile global int *)surface + bridge / (TORN_ALL + 1), bridge & TORN_ALL);
}

/* Copies a view's margins, except those looked through. count: number of margins; start: the first margin's index in
 * `seen`; kept_count: the number of copied margins, initially 0 */
kernel void keep_margins(global const float *margins, global const uchar *seen, global float *kept, global int *kept_count,
                         int count, int pitch, int kept_pitch, int start, int share)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int own = 0;
    for (int i = first; i < end; i++)
        own += !seen[start + i];
    if (!own)
        return;
    int at = atomic_add((volatile global int *)kept_count, own);
    for (int i = first; i < end; i++) {
        if (seen[start + i])
            continue;
        for (int plane = 0; plane < MARGIN_PLANES; plane++)
            kept[plane * (size_t)kept_pitch + at] = margins[plane * (size_t)pitch + i];
        at++;
    }
}
