/* The surface of a depth image: its samples, which of them are torn apart, and half a pixel more at its border.
 *
 * Two neighbours are one surface if it faces the camera (their difference of nearness is that of no steep slope), or if
 * it goes on: the slope on one side foretells their rise. From one side alone the slope may grow by a tenth. It may grow
 * more if the other side is steep in the same direction, or has no sample: a surface that bends away is steep on both sides
 * or ends, and a step from its limb to another surface is steep on one. A sample between two surfaces, half of each, goes
 * on to neither: two of three samples agree on half of its rise. Noise and the steps of a scale make no edges;
 * the mean of three lines beside each other foretells with less noise. Or, by number, depths of a greater ratio are torn
 * apart (Cut).
 *
 * A sample covers its pixel: beyond the outermost samples lies a ring of further ones, each on the straight line through
 * the two within, so that the surface can be followed up to the edges of the picture's pixels (lib/surface.h), where it
 * ends.
 *
 * nearness: (height, pitch) as picture/nearness.cl has it. surface: (height + 2, pitch), the same with the ring;
 * the last bits of each are its TORN_... ones (which changes it by 5e-7 of itself, at most). ring: (2, 2 width + 2 height
 * + 4) how near and how far the surface is half a pixel beyond each border sample: (inf, -inf) if it is not there.
 * Work-item of find_edges: `piece` samples of a row, a multiple of LANES or all; of continue_border: a sample of the ring,
 * after it. Cost: O(samples). Determinism: each sample from depths alone.
 */
#include "lib/lanes.h"
#include "lib/surface.h"

typedef struct {
    global const float *nearness;
    int width, height, pitch;
} Image;

/* Those of samples x to x + LANES - 1 of a row that are there, of which the first is not */
OUTLINED floatl samples_across(global const float *row, int x, int width)
{
    floatl n = NO_SURFACE;
    for (int lane = -x; lane < min(LANES, width - x); lane++)
        set_float_lane(n, lane, row[x + lane]);
    return n;
}

/* Samples (x, y) to (x + LANES - 1, y) */
INLINED floatl samples_from(Image image, int x, int y)
{
    if (y < 0 || y >= image.height)
        return NO_SURFACE;
    global const float *row = image.nearness + (size_t)y * image.pitch;
    if (x < 0)
        return samples_across(row, x, image.width);
    /* Rows have room for whole packets. */
    return select_lanes(x + lane_index < image.width, (floatl)(load_lanes(row + x)), (floatl)NO_SURFACE);
}

#define KEEP_GROWTH 0.1f   /* growth of a slope from one side alone: an edge is steeper than what leads to it */
#define BEND_GROWTH 0.6f   /* growth if the other side is steep, too, or ends: a sphere's last slopes grow by less than half */
#define STEEP_TIMES 4.0f  /* a pair is at most so many times as steep as a side that bends to it, */
#define SAME_TIMES 2.05f  /* or as what both sides agree on: a sample less, as where a slope is rounded to steps */
#define LEAST_RISE 0.05f /* share of a slope: a pair that rises by less is a step beside a greater one */

/* Slopes on one side of a pair, in the direction in which the pair rises: by the nearest two samples, and the lesser of that
 * and the mean of the nearest three, or 0. A sample between two surfaces halves it. */
typedef struct {
    floatl nearest, agreed;
    intl known;
} Slope;

/* The slope from sample `a` of a pair outwards. (A choice of the result instead is more than Debian 13's LLVM compiles for
 * one lane.) */
INLINED Slope slope_at(Image image, int x, int y, int dx, int dy, floatl sign)
{
    const floatl a = samples_from(image, x, y), next = samples_from(image, x + dx, y + dy);
    const floatl after = samples_from(image, x + 2 * dx, y + 2 * dy);
    Slope slope;
    slope.known = (a > NO_SURFACE) & (next > NO_SURFACE);
    const floatl one = a - select_lanes(slope.known, next, a);
    const floatl two = a - select_lanes(slope.known & (after > NO_SURFACE), after, a - 2.0f * one);
    slope.nearest = sign * one;
    slope.agreed = max_lanes(min_lanes(slope.nearest, 0.5f * sign * two), (floatl)0.0f);
    return slope;
}

/* Does a rise follow a slope that may grow by a part of itself? */
INLINED intl follows(floatl rise, floatl slope, floatl growth, floatl allowed)
{
    const floatl sure = max_lanes(slope - allowed, (floatl)0.0f);
    return (rise <= slope + allowed + growth * sure) & (rise >= LEAST_RISE * sure);
}

/* Does a rise go on from one side, given the other? */
INLINED intl goes_on_from(floatl rise, Slope side, Slope other, floatl allowed)
{
    const intl bends = (STEEP_TIMES * other.nearest >= rise - allowed) | !other.known;
    const floatl growth = select_lanes(bends, (floatl)BEND_GROWTH, (floatl)KEEP_GROWTH);
    return side.known & follows(rise, select_lanes(bends, side.nearest, side.agreed), growth, allowed);
}

/* Does a rise follow the mean slope on one side of three lines, where it is known? */
INLINED intl follows_mean(floatl rise, Slope a, Slope b, Slope c, floatl allowed)
{
    const floatl count = fabs(to_floatl(a.known + b.known + c.known)); /* true is 1 for one lane, -1 for many */
    const floatl mean = (a.agreed + b.agreed + c.agreed) / max_lanes(count, (floatl)1.0f);
    return (count > 0.0f) & follows(rise, mean, KEEP_GROWTH, allowed);
}

/* Does a surface go on from each of the wanted samples to the next along (dx, dy)? The lines beside them tell, too, but
 * those of diagonals. */
OUTLINED intl goes_on(Image image, int x, int y, int dx, int dy, floatl allowed, intl wanted)
{
    const floatl change = samples_from(image, x + dx, y + dy) - samples_from(image, x, y), rise = fabs(change);
    const floatl sign = select_lanes(change < 0.0f, (floatl)-1.0f, (floatl)1.0f);
#define BEFORE(side) slope_at(image, x + (side) * dy, y + (side) * dx, -dx, -dy, sign)
#define AFTER(side) slope_at(image, x + dx + (side) * dy, y + dy + (side) * dx, dx, dy, -sign)
    const Slope before = BEFORE(0), after = AFTER(0);
    const intl alone = goes_on_from(rise, before, after, allowed) | goes_on_from(rise, after, before, allowed) |
                       (rise <= allowed + SAME_TIMES * min_lanes(before.agreed, after.agreed));
    if (dx && dy) /* where nothing is known, as in corners, the cell's other edges decide */
        return alone | !(before.known | after.known);
    if (!any_lane(wanted & !alone))
        return alone;
    return alone | follows_mean(rise, BEFORE(-1), before, BEFORE(1), allowed) |
           follows_mean(rise, AFTER(-1), after, AFTER(1), allowed);
}

/* May samples a and b be torn apart? The Cut tells by itself that they are. Else, they may be if their change is that of no
 * surface which faces the camera, or if one is missing. per_pixel: the test's, in the direction from the one to the other */
INLINED intl may_be_torn(floatl a, floatl b, float per_pixel, Cut cut, EdgeTest test)
{
    const floatl near = max_lanes(a, b), far = min_lanes(a, b);
    if (!test.straight)
        return IS_OPEN(cut, near, far);
    return (near - far > (test.perspective ? per_pixel * far : (floatl)per_pixel)) | (far <= NO_SURFACE);
}

/* Is each of LANES samples a, which are (x, y) to (x + LANES - 1, y), torn apart from its neighbour b at (dx, dy), of those
 * that `may` be? */
INLINED intl torn_along(Image image, int x, int y, int dx, int dy, floatl a, floatl b, intl may, Cut cut, EdgeTest test)
{
    if (!test.straight)
        return may;
    const floatl near = max_lanes(a, b), far = min_lanes(a, b);
    const intl missing = far <= NO_SURFACE;
    const floatl noise = test.noise[0] + near * (test.noise[1] + near * test.noise[2]);
    intl apart = (!missing) & may & (near - far > noise);
    if (test.both)
        apart = apart & IS_OPEN(cut, near, far);
    if (!any_lane(apart))
        return missing;
    return missing | (apart & !goes_on(image, x, y, dx, dy, noise, apart));
}

/* The number nearest to a float's, of those with these last bits */
#define NEAREST_WITH_BITS(number, bits) ((((number) - (bits) + (TORN_ALL + 1) / 2) & ~TORN_ALL) | (bits))

#define LEAST_BEYOND 1e-3f /* of the border's nearness: the ring's is at least that */

/* Packets of samples, of those to their right and of those below them, and which of them may be torn apart */
typedef struct {
    floatl here, right, below;
    intl may_right, may_below, may_across;
} Packet;

/* TORN_... bits of the packet of samples x0 to x0 + LANES - 1 of a row */
INLINED intl torn_bits(const Packet *n, Image image, int x0, int y, Cut cut, EdgeTest test)
{
    const intl solid = n->here > NO_SURFACE, last = x0 + lane_index == image.width - 1;
    const int is_bottom = y + 1 == image.height;
    const intl below = is_bottom ? !solid : torn_along(image, x0, y, 0, 1, n->here, n->below, n->may_below, cut, test);
    const intl right =
        select_lanes(last, !solid, torn_along(image, x0, y, 1, 0, n->here, n->right, n->may_right, cut, test));
    /* The diagonal from the right neighbour to the one below; of the last ones a neighbour is in the ring. */
    intl diagonal =
        is_bottom ? right : torn_along(image, x0 + 1, y, -1, 1, n->right, n->below, n->may_across, cut, test);
    diagonal = select_lanes(last, below, diagonal);
    return select_lanes(right, (intl)TORN_RIGHT, (intl)0) | select_lanes(below, (intl)TORN_BELOW, (intl)0) |
           select_lanes(diagonal, (intl)TORN_DIAGONAL, (intl)0);
}

/* Writes the surface's samples `first` to `end` - 1 of a row. */
OUTLINED void mark_row(Image image, int first, int end, int y, Cut cut, EdgeTest test, global float *row)
{
    for (int x0 = first; x0 < end; x0 += LANES) {
        Packet n;
        n.here = samples_from(image, x0, y);
        n.right = samples_from(image, x0 + 1, y);
        n.below = samples_from(image, x0, y + 1);
        n.may_right = may_be_torn(n.here, n.right, test.per_pixel[0], cut, test);
        n.may_below = may_be_torn(n.here, n.below, test.per_pixel[1], cut, test);
        n.may_across = may_be_torn(n.right, n.below, test.per_pixel[2], cut, test);
        intl bits = 0;
        if (any_lane(n.may_right | n.may_below | n.may_across)) /* most are not */
            bits = torn_bits(&n, image, x0, y, cut, test);
        /* A missing sample's bits to the right and below keep it NO_SURFACE. */
        const intl of_missing = ((intl)as_int(NO_SURFACE) & ~TORN_ALL) | bits;
        const floatl marked =
            as_floatl(select_lanes(n.here > NO_SURFACE, NEAREST_WITH_BITS(as_intl(n.here), bits), of_missing));
        store_lanes(marked, row + x0); /* there is room for whole packets */
    }
}

kernel void find_edges(global const float *nearness, global float *surface, int width, int height, int pitch, int piece,
                       Cut cut, EdgeTest test)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1);
    const Image image = {nearness, width, height, pitch};
    if (y < height)
        mark_row(image, first, min(first + piece, width), y, cut, test, surface + (size_t)(y + 1) * pitch + 1);
}

/* A marked sample of the surface, by the image's numbers */
#define MARKED(x, y) surface[(size_t)((y) + 1) * pitch + (x) + 1]

kernel void continue_border(global const float *nearness, global float *surface, global float *ring, int width, int height,
                            int pitch)
{
    const int i = get_global_id(0), row = width + 2, count = 2 * row + 2 * height;
    if (i >= count)
        return;
    /* Rows above and below, then columns to the left and to the right */
    const int x = i < 2 * row ? i % row - 1 : (i - 2 * row < height ? -1 : width);
    const int y = i < 2 * row ? (i < row ? -1 : height) : (i - 2 * row) % height;
    const int bx = clamp(x, 0, width - 1), by = clamp(y, 0, height - 1), ix = bx + (bx - x), iy = by + (by - y);
    const float n = nearness[(size_t)by * pitch + bx];
    const int bits = as_int(MARKED(bx, by));
    float beyond = n;
    if (ix != bx && ix >= 0 && ix < width && !(as_int(MARKED(min(ix, bx), by)) & TORN_RIGHT))
        beyond += n - nearness[(size_t)by * pitch + ix];
    if (iy != by && iy >= 0 && iy < height && !(as_int(MARKED(bx, min(iy, by))) & TORN_BELOW))
        beyond += n - nearness[(size_t)iy * pitch + bx];
    /* Half a pixel on, at most twice as far as the border sample, or half as far. */
    beyond = n > 0.0f ? clamp(beyond, LEAST_BEYOND * n, 2.0f * n) : clamp(beyond, 2.0f * n, LEAST_BEYOND * n);
    /* Edges along the border are torn where the border's are; to the ring there are none. */
    const int along_row = x == bx && (bits & TORN_RIGHT), along_column = y == by && (bits & TORN_BELOW);
    int torn = (along_row ? TORN_RIGHT : 0) | (along_column ? TORN_BELOW : 0);
    if ((y < 0 && along_row) || (x < 0 && along_column))
        torn |= TORN_DIAGONAL;
    const int is_there = n > NO_SURFACE;
    MARKED(x, y) = as_float(is_there ? NEAREST_WITH_BITS(as_int(beyond), torn) : as_int(MISSING_SAMPLE));
    ring[i] = is_there ? 0.5f * (n + beyond) : INFINITY;
    ring[count + i] = is_there ? 0.5f * (n + beyond) : -INFINITY;
}
