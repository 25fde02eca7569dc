/* Finds the surface of a depth image: its samples, the edges between them, and half a pixel more at the border.
 *
 * Two neighbours lie on one surface if the surface faces the camera (their difference of nearness is too small for a
 * steep slope), or if it continues: the slope on one side of the pair predicts the rise from one neighbour to the
 * other. From this side to the pair, the slope may grow by a tenth. It may grow by more if the other side of the pair
 * is steep in the same direction, or has no sample: a surface that bends away is steep on both sides or ends, but a
 * step from its limb to another surface is steep on one side only. A sample that mixes two surfaces continues neither:
 * the mean slope over this sample and the next two of one surface is only half of its rise to the other. Noise and the
 * steps of a quantized scale are not edges. If a pair in a row or column fails this test, the mean of the slopes on one
 * side of it, taken from its own and the two adjacent rows (or columns), is tried, because it has less noise. A Cut
 * (lib/surface.h) may replace the test; or pairs are torn apart only if test and Cut both tear them.
 *
 * A sample covers its pixel. So a ring of further samples surrounds the image; each lies on the straight line through
 * the two nearest samples inside. With the ring, the surface extends to the edges of the image's pixels.
 *
 * nearness: (height, pitch) of picture/nearness.cl. noise: picture/noise.cl. surface: (height + 2, pitch) nearness
 * with the ring. The last bits of each sample store which of its edges are torn (TORN_..., lib/surface.h), which
 * changes nearness by at most 5e-7 of its value. ring: (2, 2 width + 2 height + 4) nearness half a pixel beyond each
 * border sample. The first row has inf for invalid samples and is used for minima; the second has -inf, for maxima.
 * Work-item: `piece` samples of a row, a multiple of LANES or the whole row (find_edges); a sample of the ring
 * (continue_border, launched next). Cost: O(samples). Determinism: each sample depends on depths alone.
 */
#include "lib/lanes.h"
#include "lib/surface.h"

typedef struct {
    global const float *nearness;
    int width, height, pitch;
} Image;

/* Samples (x, y), one per lane; NO_SURFACE outside of the image */
INLINED floatl image_samples(Image image, intl x, intl y)
{
    const intl inside = (x >= 0) & (x < image.width) & (y >= 0) & (y < image.height);
    const intl at = select_lanes(inside, y * image.pitch + x, (intl)0);
    return select_lanes(inside, (floatl)(gather(image.nearness, at)), (floatl)NO_SURFACE);
}

#define KEEP_GROWTH 0.1f   /* fraction by which a surface's slope may grow from pair to pair; at edges, it grows more */
#define BEND_GROWTH 0.6f   /* the same if the other side is steep or ends: a sphere's last slopes grow by under half */
#define STEEP_TIMES 4.0f   /* a pair's other side is steep if the pair rises by at most this many times its slope */
#define SAME_TIMES 2.05f   /* a rise may be this many times the sides' smaller slope: quantization may double it */
#define LEAST_RISE 0.05f   /* fraction of the slope on one side: if a pair rises by less, that side has a step */

/* Slopes on one side of a pair, positive if nearness changes there in the same direction as within the pair. `nearest`:
 * from the two nearest samples; `agreed`: the smaller of `nearest` and the mean slope of the three nearest samples, at
 * least 0. A mixed sample halves `agreed`. */
typedef struct {
    floatl nearest, agreed;
    intl known;
} Slope;

/* The slope on one side of a pair: from the pair's sample (x, y) outwards, along (dx, dy). (The operands are selected,
 * not the results: Debian 13's LLVM cannot compile the latter for one lane.) */
INLINED Slope slope_at(Image image, intl x, intl y, intl dx, intl dy, floatl sign)
{
    const floatl a = image_samples(image, x, y), next = image_samples(image, x + dx, y + dy);
    const floatl after = image_samples(image, x + 2 * dx, y + 2 * dy);
    Slope slope;
    slope.known = (a > NO_SURFACE) & (next > NO_SURFACE);
    const floatl one = a - select_lanes(slope.known, next, a);
    const floatl two = a - select_lanes(slope.known & (after > NO_SURFACE), after, a - 2.0f * one);
    slope.nearest = sign * one;
    slope.agreed = max_lanes(min_lanes(slope.nearest, 0.5f * sign * two), (floatl)0.0f);
    return slope;
}

/* Tells whether a rise follows from a slope that may grow by the factor 1 + growth, and be off by `allowed`. */
INLINED intl follows(floatl rise, floatl slope, floatl growth, floatl allowed)
{
    const floatl sure = max_lanes(slope - allowed, (floatl)0.0f);
    return (rise <= slope + allowed + growth * sure) & (rise >= LEAST_RISE * sure);
}

/* Tells whether a pair continues the surface on its one `side`; the `other` decides how much the slope may grow. */
INLINED intl goes_on_from(floatl rise, Slope side, Slope other, floatl allowed)
{
    const intl bends = (STEEP_TIMES * other.nearest >= rise - allowed) | !other.known;
    const floatl growth = select_lanes(bends, (floatl)BEND_GROWTH, (floatl)KEEP_GROWTH);
    return side.known & follows(rise, select_lanes(bends, side.nearest, side.agreed), growth, allowed);
}

/* Tells whether a pair's rise follows from the mean of the known slopes on one side of it, in three adjacent lines. */
INLINED intl follows_mean(floatl rise, Slope a, Slope b, Slope c, floatl allowed)
{
    const floatl count = fabs(to_floatl(a.known + b.known + c.known)); /* true is 1 for one lane, -1 for many */
    const floatl mean = (a.agreed + b.agreed + c.agreed) / max_lanes(count, (floatl)1.0f);
    return (count > 0.0f) & follows(rise, mean, KEEP_GROWTH, allowed);
}

#define ROUNDED_DOWN 0.999999f /* factor that makes a limit safe against rounding */

/* Tells whether a surface continues from the wanted samples (x, y) to (x + dx, y + dy). For pairs in rows and columns,
 * the adjacent lines are read, too. */
OUTLINED intl goes_on(Image image, intl x, intl y, intl dx, intl dy, EdgeTest test, intl wanted)
{
    const floatl here = image_samples(image, x, y), next = image_samples(image, x + dx, y + dy);
    const floatl change = next - here, rise = fabs(change), allowed = EXPLAINED(test, max_lanes(here, next));
    const floatl sign = select_lanes(change < 0.0f, (floatl)-1.0f, (floatl)1.0f);
#define BEFORE(side) slope_at(image, x + (side) * dy, y + (side) * dx, -dx, -dy, sign)
#define AFTER(side) slope_at(image, x + dx + (side) * dy, y + dy + (side) * dx, dx, dy, -sign)
    const Slope before = BEFORE(0), after = AFTER(0);
    const intl diagonal = (dx & dy) != 0; /* if no slope is known, as in corners, only the cell's edges may be torn */
    const intl alone = goes_on_from(rise, before, after, allowed) | goes_on_from(rise, after, before, allowed) |
                       (rise <= allowed + SAME_TIMES * min_lanes(before.agreed, after.agreed)) |
                       (diagonal & !(before.known | after.known));
    if (!any_lane(wanted & !(alone | diagonal)))
        return alone;
    const intl mean = follows_mean(rise, BEFORE(-1), before, BEFORE(1), allowed) |
                      follows_mean(rise, AFTER(-1), after, AFTER(1), allowed);
    return alone | (mean & !diagonal);
}

/* A part of a row that is processed at once: the bits of its samples, and the pairs of samples that may be torn apart.
 * Pairs are collected until they fill a packet, then tested. */
typedef struct {
    int bits[STRIP * LANES];        /* TORN_... bits, starting at sample `first` */
    int x[4 * LANES], edge[4 * LANES]; /* each pair: the column of the sample that stores its bit; the bit */
    int pairs, first, y;
} Part;

#define PLACE(i) (LANES == 1 ? 0 : (i)) /* index in a part's arrays: always 0 on GPUs, which keep them in registers */

/* Tests and removes the last LANES collected pairs, or all if there are fewer. */
OUTLINED void test_pairs(Part *part, Image image, EdgeTest test)
{
    const int count = min(part->pairs, LANES), from = PLACE(part->pairs - count);
    const intl wanted = lane_index < count;
    const intl x = select_lanes(wanted, (intl)load_lanes(part->x + from), (intl)part->first);
    const intl edge = select_lanes(wanted, (intl)load_lanes(part->edge + from), (intl)TORN_RIGHT);
    const intl down = edge != TORN_RIGHT, across = edge == TORN_DIAGONAL; /* across: a diagonal */
    const intl dx = select_lanes(across, (intl)-1, select_lanes(down, (intl)0, (intl)1));
    const intl dy = select_lanes(down, (intl)1, (intl)0);
    const intl goes = goes_on(image, select_lanes(across, x + 1, x), (intl)part->y, dx, dy, test, wanted);
    for (uint torn = lane_bits(wanted & !goes); torn; torn = WITHOUT_LOWEST(torn)) {
        const int at = int_lane(x, LOWEST(torn)), bit = int_lane(edge, LOWEST(torn));
        /* In the image's last row or column, one end of the diagonal lies in the ring, so it is torn if this edge
         * is. */
        const int is_last = bit == TORN_RIGHT ? part->y + 1 == image.height : at + 1 == image.width;
        part->bits[PLACE(at - part->first)] |= bit | (is_last ? TORN_DIAGONAL : 0);
    }
    part->pairs = from;
}

/* Tells whether samples a and b are torn apart for sure: one is missing, or the test is a Cut that tears them. Sets
 * `may` (they may be torn) for other pairs whose change exceeds what noise explains, and exceeds `per_pixel`, the limit
 * in this pair's direction for surfaces that face the camera; with test.both, the Cut must also tear them. */
INLINED intl torn_for_sure(floatl a, floatl b, float per_pixel, Cut cut, EdgeTest test, intl *may)
{
    const floatl near = max_lanes(a, b), far = min_lanes(a, b);
    *may = 0;
    if (!test.straight)
        return IS_OPEN(cut, near, far);
    const floatl change = near - far;
    *may = (change > (test.perspective ? per_pixel * far : (floatl)per_pixel)) & (change > EXPLAINED(test, near)) &
           (far > NO_SURFACE);
    if (test.both)
        *may = *may & IS_OPEN(cut, near, far);
    return far <= NO_SURFACE;
}

/* Collects pairs in the mask `may`: those that samples x to x + LANES - 1 form along `edge`, a TORN_... bit. */
INLINED void add_pairs(Part *part, Image image, int x, int edge, intl may, EdgeTest test)
{
    for (uint left = lane_bits(may); left; left = WITHOUT_LOWEST(left)) {
        const int i = PLACE(part->pairs);
        part->x[i] = x + LOWEST(left);
        part->edge[i] = edge;
        part->pairs++;
        if (LANES == 1)
            test_pairs(part, image, test);
    }
}

/* The nearness of a packet of samples, and of their neighbours to the right and below */
typedef struct {
    floatl here, right, below;
} Packet;

INLINED Packet packet_at(Image image, int x, int y)
{
    global const float *own = image.nearness + (size_t)y * image.pitch + x;
    const int is_bottom = y + 1 == image.height;
    Packet n;
    n.here = load_lanes(own); /* rows have room for whole packets */
    n.right = load_lanes(own + 1);
    n.below = is_bottom ? (floatl)NO_SURFACE : load_lanes(own + image.pitch);
    if (x + LANES >= image.width) {
        const intl column = x + lane_index;
        n.here = select_lanes(column < image.width, n.here, (floatl)NO_SURFACE);
        n.right = select_lanes(column + 1 < image.width, n.right, (floatl)NO_SURFACE);
        n.below = select_lanes(column < image.width, n.below, (floatl)NO_SURFACE);
    }
    return n;
}

/* Sets the bits of the packet that starts at x, and collects the pairs to test. */
OUTLINED void mark_packet(Part *part, Packet n, Image image, int x, Cut cut, EdgeTest test)
{
    const intl missing = n.here <= NO_SURFACE, last = x + lane_index == image.width - 1, none = 0;
    const int is_bottom = part->y + 1 == image.height;
    intl may_right, may_below, may_across;
    intl right = torn_for_sure(n.here, n.right, test.per_pixel[0], cut, test, &may_right);
    intl below = torn_for_sure(n.here, n.below, test.per_pixel[1], cut, test, &may_below);
    intl across = torn_for_sure(n.right, n.below, test.per_pixel[2], cut, test, &may_across);
    right = select_lanes(last, missing, right);
    below = is_bottom ? missing : below;
    across = select_lanes(last, below, is_bottom ? right : across);
    const intl bits = select_lanes(right, (intl)TORN_RIGHT, none) | select_lanes(below, (intl)TORN_BELOW, none) |
                      select_lanes(across, (intl)TORN_DIAGONAL, none);
    store_lanes(bits, part->bits + PLACE(x - part->first));
    add_pairs(part, image, x, TORN_RIGHT, may_right & !last, test);
    if (!is_bottom) {
        add_pairs(part, image, x, TORN_BELOW, may_below, test);
        add_pairs(part, image, x, TORN_DIAGONAL, may_across & !last, test);
    }
    while (part->pairs >= LANES)
        test_pairs(part, image, test);
}

/* Tells whether any pair in a packet may be torn apart, from the nearness of each sample and its two neighbours. */
INLINED int any_torn(Packet n, Cut cut, EdgeTest test)
{
    const floatl near = max_lanes(max_lanes(n.here, n.right), n.below);
    const floatl far = min_lanes(min_lanes(n.here, n.right), n.below);
    if (!test.straight)
        return any_lane(IS_OPEN(cut, near, far));
    const float least = min(test.per_pixel[0], test.per_pixel[1]);
    const floatl slope = test.perspective ? least * far : (floatl)least;
    const floatl noise = EXPLAINED(test, test.perspective ? far : near); /* the least of the pairs' limits */
    return any_lane((near - far > ROUNDED_DOWN * max_lanes(slope, noise)) | (far <= NO_SURFACE));
}

/* The bits of a float, rounded to the nearest float that has the given last bits */
#define NEAREST_WITH_BITS(number, bits) ((((number) - (bits) + (TORN_ALL + 1) / 2) & ~TORN_ALL) | (bits))

#define LEAST_BEYOND 1e-3f /* least nearness in the ring, as a fraction of the border sample's */

/* Writes LANES samples with their bits, starting at x, to a row of `width` samples. */
INLINED void store_marked(floatl here, intl bits, global float *row, int x, int width)
{
    /* A missing sample stays NO_SURFACE, with its bits. */
    const intl of_missing = ((intl)as_int(NO_SURFACE) & ~TORN_ALL) | bits;
    const floatl marked =
        as_floatl(select_lanes(here > NO_SURFACE, NEAREST_WITH_BITS(as_intl(here), bits), of_missing));
    store_first(marked, row + x, width - x); /* not the ring, which another work-item may have written */
}

/* Writes the samples `first` to `end` - 1 of a row of the surface. */
OUTLINED void mark_row(Image image, int first, int end, int y, Cut cut, EdgeTest test, global float *row)
{
    Part part;
    part.pairs = 0;
    part.y = y;
    for (part.first = first; part.first < end; part.first += STRIP * LANES) {
        int torn[STRIP], count = 0;
        for (int x = part.first; x < min(part.first + STRIP * LANES, end); x += LANES) {
            const Packet n = packet_at(image, x, y);
            if (any_torn(n, cut, test)) {
                torn[PLACE(count)] = x;
                count++;
                mark_packet(&part, n, image, x, cut, test);
            } else { /* most packets */
                store_marked(n.here, (intl)0, row, x, image.width);
            }
        }
        if (part.pairs)
            test_pairs(&part, image, test);
        for (int i = 0; i < count; i++) {
            const int x = torn[PLACE(i)];
            const intl bits = load_lanes(part.bits + PLACE(x - part.first));
            store_marked(packet_at(image, x, y).here, bits, row, x, image.width);
        }
    }
}

kernel void find_edges(global const float *nearness, global const float *noise, global float *surface, int width,
                       int height, int pitch, int piece, Cut cut, EdgeTest test)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1);
    const Image image = {nearness, width, height, pitch};
    if (y < height)
        mark_row(image, first, min(first + piece, width), y, cut, with_noise(test, noise),
                 surface + (size_t)(y + 1) * pitch + 1);
}

/* A sample of the surface, by its column and row in the image */
#define MARKED(x, y) surface[(size_t)((y) + 1) * pitch + (x) + 1]

/* Writes sample `i` of the ring. */
OUTLINED void continue_at(Image image, global float *surface, global float *ring, int i)
{
    const int width = image.width, height = image.height, pitch = image.pitch, row = width + 2, count = 2 * row + 2 * height;
    global const float *nearness = image.nearness;
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
    /* Limits the ring, so that half a pixel beyond a border sample, nearness is half to 1.5 times the sample's. */
    beyond = n > 0.0f ? clamp(beyond, LEAST_BEYOND * n, 2.0f * n) : clamp(beyond, 2.0f * n, LEAST_BEYOND * n);
    /* An edge within the ring is torn if the image's edge beside it is; edges between image and ring are not. */
    const int along_row = x == bx && (bits & TORN_RIGHT), along_column = y == by && (bits & TORN_BELOW);
    int torn = (along_row ? TORN_RIGHT : 0) | (along_column ? TORN_BELOW : 0);
    if ((y < 0 && along_row) || (x < 0 && along_column))
        torn |= TORN_DIAGONAL;
    const int is_there = n > NO_SURFACE;
    MARKED(x, y) = as_float(is_there ? NEAREST_WITH_BITS(as_int(beyond), torn) : as_int(MISSING_SAMPLE));
    ring[i] = is_there ? 0.5f * (n + beyond) : INFINITY;
    ring[count + i] = is_there ? 0.5f * (n + beyond) : -INFINITY;
}

kernel void continue_border(global const float *nearness, global float *surface, global float *ring, int width, int height,
                            int pitch)
{
    const Image image = {nearness, width, height, pitch};
    if (get_global_id(0) < 2 * (width + 2) + 2 * height)
        continue_at(image, surface, ring, get_global_id(0));
}
