/* Estimates the noise of depth and, if depths are quantized, their steps. It reads strips of three adjacent rows or
 * columns.
 *
 * Neighbouring samples form cells of 2 x 2. On a plane, without noise, a cell's two rows have the same difference of
 * nearness, and so have its two columns. Quantized depths form stairs: a sample equals one neighbour and differs from
 * the other by a step. Both kinds of differences are collected for ranges of nearness, and a polynomial in depth is
 * fitted to each kind.
 *
 * depth: (height, width) planar z; depths <= 0, not finite or >= far are ignored. cells: approximate number of cells
 * to read. tables: NoiseTables, then room for the strips (pyibr/picture/noise.py). noise: 6 floats: a, b, c of the
 * noise's standard deviation a z^2 + b z + c at depth z, then a, b, c of the steps' size. Work-item: the launch has one
 * work-group, which divides each loop among its work-items. Cost: O(cells). Determinism: shared sums are sums of
 * integers. tests/reference/noise.py computes the same in NumPy.
 */
#include "lib/lanes.h"

#define NOISE_ITEMS 256         /* greatest number of work-items */
#define NOISE_RANGES 64         /* ranges of nearness, 1/4 octave each, nearest first; the last has no end */
#define NOISE_SIZES 144         /* bins of a histogram of differences divided by nearness, 1/8 octave each */
#define NOISE_STAIRS 4128       /* greatest number of stairs, 4096, and room for two more packets */
#define FIRST_SIZE 879          /* upper 12 bits of the floats in the first bin, which collects rounding errors */
#define LAST_SIZE 137           /* number of the last bin */
#define NEAREST_RANGE 508       /* upper 11 bits of the float 1, the end of the nearest range */
#define EDGE_PART 0.1f          /* fraction of nearness: larger differences are edges */
#define OFF_STEP 0.2f           /* in steps: how far a jump may be from one step, and a gap from a whole number of
                                   steps; an image may mix two scales */
#define FIT_CHOICES 0x7653421   /* the subsets of the terms a, b, c that are fitted; each hexadecimal digit is a mask */
#define NOISE_MAX 1e18f         /* its square still fits into single precision */

typedef struct {
    int counts[3][NOISE_RANGES][NOISE_SIZES];        /* histograms: changes over 1 sample, over 2, jumps */
    int every[2][NOISE_RANGES], sums[2][NOISE_RANGES]; /* number of cells (0) and stairs (1), and sums of nearness */
    int levels[NOISE_RANGES];                        /* number of cells with four equal samples */
    int nearest, known, smooth, high, farthest, last, changes, steep, whole, below, near_one, ones, gaps, whole_gaps,
        grade, half_steps;
    int stairs_of[NOISE_ITEMS], steep_of[NOISE_ITEMS]; /* counts of each work-item */
    int kept, grades[NOISE_RANGES];                    /* ranges' grades: 0: few cells, 1: good, 2: also few edges */
    float near_by[NOISE_RANGES], far_by[NOISE_RANGES]; /* deviation of differences over 1 sample, over 2 samples */
    float depth[NOISE_RANGES], deviation[NOISE_RANGES], share[NOISE_RANGES]; /* the fit's data and weights */
    float fits[7][4];                                                        /* a, b, c, and the fit's error */
    float places[NOISE_STAIRS], ratios[NOISE_STAIRS]; /* stairs: nearness, and jump divided by the step */
} NoiseTables;

#define CLEARED ((3 * NOISE_SIZES + 5) * NOISE_RANGES + 16 + 2 * NOISE_ITEMS) /* number of ints before `kept` */

typedef struct {
    global NoiseTables *t;
    global float *strips; /* (3, stride) nearness, NaN where invalid */
    int stride, item, items;
} Estimate;

#if LANES == 1
#define MEET barrier(CLK_GLOBAL_MEM_FENCE);
#define ADD_TO(place, value) atomic_add(&(place), value)
#define RAISE(place, value) atomic_max(&(place), value)
#else
#define MEET
#define ADD_TO(place, value) ((place) += (value))
#define RAISE(place, value) ((place) = max(place, (int)(value)))
#endif
#define OWN_PACKETS(e, i, end) (int i = (e).item * LANES; i < (end); i += (e).items * LANES)
#define OWN_RANGES(e, i) (int i = (e).item; i < NOISE_RANGES; i += (e).items)
#define TALLY(place, mask)                                                                                     \
    if (lane_bits(mask))                                                                                       \
        ADD_TO(place, (int)popcount(lane_bits(mask)));
#define IS_WHOLE_NUMBER(x, off) (fabs((x)-floor_lanes((x) + 0.5f)) < (off))
#define RANGE_OF(near) clamp(NEAREST_RANGE - (as_int(near) >> 21), 0, NOISE_RANGES - 1)
#define STRIDE_OF(count) (((count) / LANES + 2) * LANES) /* with room for one more packet at the end */
#define STRIPS_OF(length, lines, cells) min(((cells) + 2 * (length)-1) / (2 * (length)), max((lines)-2, 0))

INLINED float sum_of_lanes(floatl v)
{
    float sum = 0.0f;
    for (int lane = 0; lane < LANES; lane++)
        sum += float_lane(v, lane);
    return sum;
}

/* Copies strips, each of three adjacent lines (rows or columns). Two zeros follow each line. */
INLINED void copy_strips(Estimate e, global const float *depth, int along, int across, int count, int length, int lines,
                         global float *to)
{
    for (int strip = 0; strip < count; strip++, to += length + 2) {
        /* Multiples of the golden ratio, modulo 1, spread the strips without a period that the picture could share. */
        const int line = count == lines - 2 ? strip : (int)mul_hi(strip * 2654435769u, (uint)(lines - 2));
        global const float *from = depth + (size_t)line * across;
        for (int i = e.item; i < length + 2; i += e.items)
            for (int k = 0; k < 3; k++)
                to[k * e.stride + i] = i < length ? from[(size_t)i * along + (size_t)k * across] : 0.0f;
    }
}

/* Copies the depths of strips, from the grid of every `gap`-th row and column. Returns the total length of the strips'
 * first lines, including two zeros after each. */
OUTLINED int gather_strips(Estimate e, global const float *depth, int width, int height, int gap, int cells)
{
    for OWN_PACKETS (e, i, CLEARED)
        store_lanes((intl)0, (global int *)e.t + i);
    const int w = (width + gap - 1) / gap, h = (height + gap - 1) / gap;
    const int rows = STRIPS_OF(w, h, cells), columns = STRIPS_OF(h, w, cells);
    const int in_rows = rows * (w + 2), count = in_rows + columns * (h + 2);
    e.stride = STRIDE_OF(count);
    copy_strips(e, depth, gap, gap * width, rows, w, h, e.strips);
    copy_strips(e, depth, gap * width, gap, columns, h, w, e.strips + in_rows);
    for (int i = count + e.item; i < e.stride; i += e.items)
        e.strips[i] = e.strips[e.stride + i] = e.strips[2 * e.stride + i] = 0.0f;
    return count;
}

#define IS_KNOWN_DEPTH(z) (((z) > 1e-37f) & ((z) < far))

OUTLINED void find_unit(Estimate e, float far)
{
    floatl least = INFINITY;
    for OWN_PACKETS (e, i, 3 * e.stride) {
        const floatl z = load_lanes(e.strips + i);
        least = min_lanes(select_lanes(IS_KNOWN_DEPTH(z), z, (floatl)INFINITY), least);
    }
    RAISE(e.t->nearest, as_int(INFINITY) - as_int(least_lane(least)));
}

/* The unit of depth: the power of two for which the nearest sample's depth lies between 1 and 2 units */
INLINED float noise_unit(Estimate e)
{
    return e.t->nearest ? as_float((as_int(INFINITY) - e.t->nearest) & as_int(INFINITY)) : 1.0f;
}

OUTLINED void to_noise_unit(Estimate e, float far)
{
    const float unit = noise_unit(e);
    for OWN_PACKETS (e, i, 3 * e.stride) {
        const floatl z = load_lanes(e.strips + i);
        store_lanes(select_lanes(IS_KNOWN_DEPTH(z), unit / z, (floatl)NAN), e.strips + i);
    }
}

/* Cells of 2 x 2 samples. near: mean nearness. change: the amount by which the difference between the two samples of
 * the upper line differs from that of the lower line. largest: the largest difference between neighbours. At edges
 * along rows or columns the change is 0 without noise, as on planes, so thin objects contribute their noise, too. */
typedef struct {
    floatl near, change, largest;
} NoiseCells;

INLINED NoiseCells noise_cells(Estimate e, int gap, int i)
{
    global const float *upper = e.strips + i, *lower = upper + gap * e.stride;
    const floatl a = load_lanes(upper), b = load_lanes(upper + gap), c = load_lanes(lower), d = load_lanes(lower + gap);
    const floatl above = b - a, below = d - c, side = fabs(d - b);
    const NoiseCells cells = {0.25f * (b + a + d + c), fabs(above - below),
                              max_lanes(max_lanes(fabs(above), fabs(below)), side)};
    return cells;
}

OUTLINED void count_cells(Estimate e)
{
    floatl low = INFINITY, high = 0.0f;
    for OWN_PACKETS (e, i, e.stride - LANES) {
        const NoiseCells cells = noise_cells(e, 1, i);
        TALLY(e.t->known, cells.near > 0.0f)
        TALLY(e.t->smooth, cells.largest < EDGE_PART * cells.near)
        low = min_lanes(cells.near, low);
        high = max_lanes(cells.near, high);
    }
    RAISE(e.t->high, as_int(-least_lane(-high)));
    RAISE(e.t->farthest, RANGE_OF(least_lane(low)));
}

#define SUM_SHIFT(e) max(21 - (int)clz(2 * (e).stride), 0) /* low bits that terms lose, so that sums fit into 32 bits */

INLINED void add_place(Estimate e, int kind, int range, float near)
{
    ADD_TO(e.t->every[kind][range], 1);
    ADD_TO(e.t->sums[kind][range], (as_int(near) & 0x1FFFFF) >> SUM_SHIFT(e));
}

INLINED void add_size(Estimate e, int kind, int range, float size)
{
    ADD_TO(e.t->counts[kind][range][clamp((as_int(size) >> 20) - FIRST_SIZE, 0, LAST_SIZE)], 1);
}

INLINED float range_depth(Estimate e, int kind, int range)
{
    const float mean = (float)(uint)e.t->sums[kind][range] / (float)max(e.t->every[kind][range], 1);
    return 1.0f / as_float(((NEAREST_RANGE - range) << 21) + (int)(mean * (float)(1 << SUM_SHIFT(e))));
}

OUTLINED void count_differences(Estimate e)
{
    const int all = 10 * e.t->smooth < e.t->known; /* noise hides edges (few cells are smooth): no cell is left out */
    const int first = RANGE_OF(as_float(e.t->high)), last = e.t->farthest;
    for OWN_PACKETS (e, i, e.stride - LANES) {
        const NoiseCells one = noise_cells(e, 1, i), two = noise_cells(e, 2, i);
        const intl smooth = one.largest < (all ? INFINITY : EDGE_PART * one.near);
        const floatl size = one.change / one.near, size_2 = two.change / two.near;
        for (int lane = 0; lane < LANES; lane++) {
            const float near = float_lane(one.near, lane), near_2 = float_lane(two.near, lane);
            if (near > 0.0f) {
                add_place(e, 0, RANGE_OF(near), near);
                ADD_TO(e.t->levels[RANGE_OF(near)], float_lane(one.largest, lane) == 0.0f);
                if (int_lane(smooth, lane))
                    add_size(e, 0, RANGE_OF(near), float_lane(size, lane));
            }
            if (near_2 > 0.0f)
                add_size(e, 1, clamp(RANGE_OF(near_2), first, last), float_lane(size_2, lane));
        }
    }
}

/* The mean of the smallest sizes in a histogram, the fraction `share` of all sizes. (A quantile of quantized depths
 * would jump by whole steps.) */
OUTLINED float mean_below(global const int *counts, float share)
{
    int total = 0, before = 0;
    for (int i = 0; i <= LAST_SIZE; i++)
        total += counts[i];
    const float wanted = share * (float)total;
    float sum = 0.0f;
    for (int i = 1; i <= LAST_SIZE && (float)(before += counts[i - 1]) < wanted; i++)
        sum += min(wanted - (float)before, (float)counts[i]) * as_float((2 * (FIRST_SIZE + i) + 1) << 19);
    return total ? sum / wanted : 0.0f;
}

/* The noise's standard deviation, divided by nearness, from a histogram of changes. Many changes near 0 speak against
 * noise, unless depths are quantized. */
INLINED float deviation_of(global const int *counts, int on_scale)
{
    const float most = mean_below(counts, 0.6f) / 0.39639f;
    return 0.5f * (on_scale ? most : min(most, mean_below(counts, 0.25f) * (1.4f / 0.15793f)));
}

/* Sets a range's depth, deviation and weight for the fit. */
OUTLINED void set_range(global NoiseTables *t, int range, float depth, float deviation, int count)
{
    const int is_known = count > 0 && deviation > 0.0f;
    t->depth[range] = is_known ? depth : 1.0f;
    t->deviation[range] = is_known ? deviation : 1.0f;
    t->share[range] = is_known ? (float)count : 0.0f;
    RAISE(t->last, is_known ? range : 0);
}

/* Fits a subset of the terms a z^2, b z, c to the ranges' deviations, with the least sum of absolute errors. Three
 * rounds of least squares approximate this: after each, ranges with large errors weigh less. Terms are made orthogonal
 * (Gram-Schmidt), as normal equations would need double precision. */
OUTLINED void fit_choice(global NoiseTables *t, int choice)
{
    const int packets = t->last / LANES + 1, terms = FIT_CHOICES >> 4 * choice & 7;
    floatl columns[4][NOISE_RANGES / LANES], weights[NOISE_RANGES / LANES], off = 0.0f, all = 0.0f;
    float x[3] = {0.0f, 0.0f, 0.0f}, parts[3][4];
    int is_told = 1;
    for (int round = 0; round < 3; round++) {
        floatl full[3] = {0.0f, 0.0f, 0.0f};
        for (int i = 0; i < packets; i++) {
            const floatl z = load_lanes(t->depth + i * LANES), inverse = 1.0f / load_lanes(t->deviation + i * LANES);
            weights[i] = load_lanes(t->share + i * LANES) / (round ? max_lanes(fabs(columns[3][i]), 0.02f) : 1.0f);
            columns[0][i] = z * z * inverse;
            columns[1][i] = z * inverse;
            columns[2][i] = inverse;
            columns[3][i] = 1.0f;
            for (int k = 0; k < 3; k++)
                full[k] += weights[i] * columns[k][i] * columns[k][i];
        }
        for (int k = 0; k < 3; k++) {
            if (!(terms >> k & 1))
                continue;
            floatl products[4] = {0.0f, 0.0f, 0.0f, 0.0f};
            for (int i = 0; i < packets; i++)
                for (int other = k; other < 4; other++)
                    products[other] += weights[i] * columns[k][i] * columns[other][i];
            const float square = sum_of_lanes(products[k]);
            is_told &= square > 1e-9f * sum_of_lanes(full[k]);
            for (int other = k + 1; other < 4; other++) {
                parts[k][other] = sum_of_lanes(products[other]) / square;
                for (int i = 0; i < packets; i++)
                    columns[other][i] -= parts[k][other] * columns[k][i];
            }
        }
    }
    for (int k = 2; k >= 0; k--)
        if (terms >> k & 1) {
            x[k] = parts[k][3];
            for (int other = k + 1; other < 3; other++)
                x[k] -= x[other] == 0.0f ? 0.0f : parts[k][other] * x[other];
            is_told &= x[k] >= 0.0f;
        }
    for (int i = 0; i < packets; i++) {
        off += fabs(columns[3][i]) * load_lanes(t->share + i * LANES);
        all += load_lanes(t->share + i * LANES);
    }
    const float by = sum_of_lanes(off) / sum_of_lanes(all) + 0.03f * (float)popcount(terms);
    vstore4((float4)(x[0], x[1], x[2], is_told ? by : INFINITY), choice, &t->fits[0][0]);
}

/* The best fit (a, b, c), without negative terms. A further term must reduce the mean relative error by 0.03. */
OUTLINED float4 best_fit(Estimate e)
{
    float4 best = (float4)(0.0f, 0.0f, 0.0f, INFINITY);
    MEET
    for (int choice = e.item; choice < 7; choice += e.items)
        fit_choice(e.t, choice);
    MEET
    for (int choice = 0; choice < 7; choice++) {
        const float4 fit = vload4(choice, &e.t->fits[0][0]);
        best = fit.w < best.w - 1e-6f ? fit : best;
    }
    return best;
}

/* Triples of adjacent samples. here: the middle sample's nearness; jump: by how much its two differences to its
 * neighbours differ; least: the smaller of the two differences. For i < stride, triple i lies along a strip's first
 * line; from i = stride on, triples lie across the three lines. */
typedef struct {
    floatl here, jump, least;
    intl is_change, is_stair, is_steep;
} Triples;

INLINED Triples triples_at(Estimate e, int i)
{
    const int across = i >= e.stride, next = across ? e.stride : 1;
    global const float *first = e.strips + i - across * e.stride;
    const floatl here = load_lanes(first + next), one = here - load_lanes(first);
    const floatl other = load_lanes(first + 2 * next) - here, jump = fabs(one - other);
    const floatl least = min_lanes(fabs(one), fabs(other));
    const intl is_change = (jump > 0x1p-17f * here) & (jump < 0.25f * here);
    const intl is_steep = is_change & (least > 0.0f) & ((one > 0.0f) == (other > 0.0f));
    const Triples triples = {here, jump, least, is_change, is_change & (least == 0.0f), is_steep};
    return triples;
}

#define TRIPLES_EACH(e) ((2 * (e).stride / LANES + (e).items - 1) / (e).items * LANES)
#define OWN_TRIPLES(e, i)                                                                                      \
    (int i = (e).item * TRIPLES_EACH(e); i < min(((e).item + 1) * TRIPLES_EACH(e), 2 * (e).stride - LANES); i += LANES)

/* Counts stairs: samples that equal one neighbour and differ from the other. On a quantized scale, they mostly differ
 * by one step. */
OUTLINED void count_stairs(Estimate e)
{
    for OWN_TRIPLES (e, i) {
        const Triples at = triples_at(e, i);
        const floatl steps = at.least / at.jump;
        TALLY(e.t->changes, at.is_change)
        TALLY(e.t->steep, at.is_steep)
        TALLY(e.t->whole, at.is_steep & IS_WHOLE_NUMBER(steps, 0.02f))
        TALLY(e.t->stairs_of[e.item], at.is_stair)
        TALLY(e.t->steep_of[e.item], at.is_steep)
    }
}

/* Stores every n-th stair, so that they fit into the tables, and counts their jumps by size. */
OUTLINED void keep_stairs(Estimate e)
{
    global NoiseTables *t = e.t;
    const int with_steep = 10 * t->whole > 9 * t->steep; /* on a scale, steep surfaces rise by whole steps */
    int count = 0, number = 0;
    for (int i = 0; i < e.items; i++) {
        number = i == e.item ? count : number;
        count += t->stairs_of[i] + (with_steep ? t->steep_of[i] : 0);
    }
    const int every = count / 4000 + 1, is_some = 100 * count > t->changes; /* 1 % of all changes: slopes have few */
    t->kept = is_some ? (count + every - 1) / every : 0;
    for OWN_TRIPLES (e, i) {
        const Triples at = triples_at(e, i);
        const intl mask = at.is_stair | (with_steep ? at.is_steep : 0);
        for (uint bits = is_some ? lane_bits(mask) : 0; bits; bits = WITHOUT_LOWEST(bits), number++)
            if (number % every == 0) {
                const float place = float_lane(at.here, LOWEST(bits)), jump = float_lane(at.jump, LOWEST(bits));
                t->places[number / every] = place;
                t->ratios[number / every] = jump;
                add_place(e, 1, RANGE_OF(place), place);
                add_size(e, 2, RANGE_OF(place), jump / place);
            }
    }
}

/* Sorts `count` values with a bitonic network. `count` is a power of two and at least LANES. */
OUTLINED void sort_values(Estimate e, global float *values, int count)
{
    for (int size = 2; size <= count; size *= 2)
        for (int gap = size / 2; gap > 0; gap = gap < LANES ? 0 : gap / 2) {
            for (int pair = e.item * LANES; gap >= LANES && pair < count / 2; pair += e.items * LANES) {
                const int at = 2 * pair - (pair & (gap - 1)), falls = at & size;
                const floatl a = load_lanes(values + at), b = load_lanes(values + at + gap);
                store_lanes(falls ? max_lanes(a, b) : min_lanes(a, b), values + at);
                store_lanes(falls ? min_lanes(a, b) : max_lanes(a, b), values + at + gap);
            }
#if LANES == 16
            for (int at = 0; gap < LANES && at < count; at += LANES) {
                floatl v = load_lanes(values + at);
                for (int near = gap; near > 0; near /= 2) {
                    const floatl other = near == 8   ? v.s89abcdef01234567
                                         : near == 4 ? v.s45670123cdef89ab
                                         : near == 2 ? v.s23016745ab89efcd
                                                     : v.s1032547698badcfe;
                    const intl greater = ((lane_index & near) != 0) != (((at + lane_index) & size) != 0);
                    v = select_lanes(greater, max_lanes(v, other), min_lanes(v, other));
                }
                store_lanes(v, values + at);
            }
#endif
            MEET
        }
}

/* A difference a z^2 + b z + c of depth, as a difference of nearness, at nearness `near` */
#define IN_NEARNESS(abc, near) ((abc).x + ((abc).y + (abc).z * (near)) * (near))

/* a, b, c of the steps' size; zeros if depths are not quantized */
OUTLINED float4 steps_of_stairs(Estimate e)
{
    global NoiseTables *t = e.t;
    for OWN_RANGES (e, range) {
        const float depth = range_depth(e, 1, range);
        set_range(t, range, depth, mean_below(t->counts[2][range], 0.25f) * depth, t->every[1][range]);
    }
    float4 steps = best_fit(e);
    int room = LANES;
    while (room < t->kept)
        room *= 2;
    for OWN_PACKETS (e, i, room) {
        const floatl place = load_lanes(t->places + i), ratio = load_lanes(t->ratios + i) / IN_NEARNESS(steps, place);
        const intl is_kept = i + lane_index < t->kept;
        store_lanes(select_lanes(is_kept, place, (floatl)INFINITY), t->places + i);
        store_lanes(select_lanes(is_kept, ratio, (floatl)INFINITY), t->ratios + i);
    }
    MEET
    sort_values(e, t->places, room);
    sort_values(e, t->ratios, room);
    for OWN_PACKETS (e, i, room) {
        const floatl ratio = load_lanes(t->ratios + i);
        TALLY(t->below, ratio <= 0.5f)
        TALLY(t->near_one, (ratio > 0.5f) & (ratio < 1.5f))
    }
    MEET
    const int middle = t->below + t->near_one / 2, before = middle - !(t->near_one & 1); /* the middle ratios */
    const float exact = t->near_one ? 0.5f * (t->ratios[before] + t->ratios[middle]) : 1.0f;
    steps *= exact;
    for OWN_PACKETS (e, i, t->kept) {
        const floatl place = load_lanes(t->places + i + 1), apart = place - load_lanes(t->places + i);
        const floatl number = apart / IN_NEARNESS(steps, place);
        const intl is_gap = (apart > 0.0f) & (i + 1 + lane_index < t->kept);
        TALLY(t->ones, fabs(load_lanes(t->ratios + i) / exact - 1.0f) < OFF_STEP)
        TALLY(t->gaps, is_gap)
        TALLY(t->whole_gaps, is_gap & (number > OFF_STEP) & IS_WHOLE_NUMBER(number, OFF_STEP))
    }
    MEET
    /* On a quantized scale, most jumps are one step, and most gaps between the stairs' nearness are whole numbers of
     * steps. Edges jump by any size. */
    const int is_scale = t->gaps + 1 >= 12 && 5 * t->ones >= 3 * t->kept && 5 * t->whole_gaps >= 3 * t->gaps;
    return is_scale ? steps : (float4)0.0f;
}

/* Grades the ranges, and measures the noise's deviations in them. */
OUTLINED void measure_ranges(Estimate e, int on_scale)
{
    global NoiseTables *t = e.t;
    for OWN_RANGES (e, range) {
        int total = 0;
        for (int i = 0; i <= LAST_SIZE; i++)
            total += t->counts[0][range][i];
        /* A range of equal samples, such as a sky, says nothing about other ranges. */
        const int is_good = total >= 50 && (on_scale || 4 * t->levels[range] < total);
        t->grades[range] = is_good ? 1 + (5 * total >= 4 * t->every[0][range]) : 0;
        t->near_by[range] = is_good ? deviation_of(t->counts[0][range], on_scale) : 0.0f;
        t->far_by[range] = is_good ? deviation_of(t->counts[1][range], on_scale) : 0.0f;
        set_range(t, range, 0.0f, 0.0f, total);
        RAISE(t->grade, t->grades[range]);
        t->share[range] = (float)total;
    }
}

/* Sets the ranges' deviations for the fit, from the farthest range to the nearest. Only one work-item calls it. */
OUTLINED void set_deviations(Estimate e, float4 half_)
{
    global NoiseTables *t = e.t;
    float most = INFINITY, all = 0.0f, equal = 0.0f;
    for (int range = NOISE_RANGES - 1; range >= 0; range--) {
        const float z = range_depth(e, 0, range), near_by = t->near_by[range] * z, far_by = t->far_by[range] * z;
        const float count = t->grades[range] == t->grade && t->grade ? t->share[range] : 0.0f;
        /* Changes by curvature grow with the square of the distance between samples, changes by noise do not. */
        const float square = max((9.0f * near_by * near_by - far_by * far_by) / 8.0f, 0.0f);
        all += count;
        equal += square > 0.0f ? 0.0f : count;
        set_range(t, range, z, max(min(sqrt(square), most), half_.z + (half_.y + half_.x * z) * z), (int)count);
        if (count > 0.0f)
            most = min(most, near_by * (1.15f + 4.0f / sqrt(count)));
    }
    t->half_steps = t->known < 50 || 2.0f * equal >= all;
}

/* Estimates the noise. All `items` work-items of a group call it; there are at most NOISE_ITEMS. */
OUTLINED void estimate_noise(global const float *depth, int width, int height, float far, int cells, global int *tables,
                             global float *noise, int item, int items)
{
    global NoiseTables *t = (global NoiseTables *)tables;
    Estimate e = {t, (global float *)(t + 1), 0, item, items};
    for (int gap = 1, gaps = 1; gap <= gaps; gap++) {
        const int count = gather_strips(e, depth, width, height, gap, cells);
        e.stride = STRIDE_OF(count);
        MEET
        find_unit(e, far);
        MEET
        to_noise_unit(e, far);
        MEET
        count_cells(e);
        count_stairs(e);
        MEET
        gaps = 10 * t->known < count ? 2 : 1; /* every other sample may be missing: then read every second line */
        MEET
    }
    count_differences(e);
    keep_stairs(e);
    MEET
    const float4 steps = steps_of_stairs(e), half_ = 0.5f * steps;
    measure_ranges(e, steps.x + steps.y + steps.z > 0.0f);
    MEET
    if (item == 0)
        set_deviations(e, half_);
    const float4 fit = best_fit(e), deviation = t->half_steps ? half_ : fit;
    const float unit = noise_unit(e);
    if (item == 0) {
        vstore3(fmin((float3)(deviation.x / unit, deviation.y, deviation.z * unit), NOISE_MAX), 0, noise);
        vstore3(fmin((float3)(steps.x / unit, steps.y, steps.z * unit), NOISE_MAX), 1, noise);
    }
}

kernel void find_noise(global const float *depth, global int *tables, global float *noise, int width, int height,
                       float far, int cells)
{
    const int columns = get_local_size(0);
    estimate_noise(depth, width, height, far, cells, tables, noise, get_local_id(0) + get_local_id(1) * columns,
                   columns * get_local_size(1));
}
