/* How much noise does depth have, and how far apart do levels of its scale lie? By some strips of its rows and columns.
 *
 * depth: (height, width) planar z; <= 0, not finite or >= far is no sample. tables: NoiseTables, then the strips
 * (pyibr/picture/noise.py). noise: 6 floats, (a, b, c) of the standard deviation a z^2 + b z + c, then of the steps. cells:
 * how many are sampled. Work-item: one of the only work-group. Cost: O(cells), however large the image is.
 * Determinism: shared sums are of integers. tests/reference/noise.py says the same in NumPy, with more reasons.
 *
 * All is computed in a unit of depth, a power of two, by which the nearest sample is 1 to 2.
 */
#include "lib/lanes.h"

#define NOISE_RANGES 64     /* of nearness, quarters of an octave; the last has all that is farther */
#define NOISE_SIZES 144     /* of differences, eighths of an octave */
#define NOISE_STAIRS 4128 /* room for a power of two, and a packet */
#define NOISE_STAIRS_MAX 4000
#define NOISE_ITEMS 256     /* most work-items of a group */
#define FIT_CHOICES 0x7653421 /* a digit each: which of a, b and c there are */
#define LEAST_SIZE 879      /* number of the first size, which stands for rounding */
#define LAST_SIZE 137
#define NEAREST_RANGE 508   /* quarters of an octave at nearness 1 */
#define GOLDEN_PART 2654435769u /* of 2^32 */
#define CELLS_MIN 50
#define LEVELS_MIN 12
#define ROUNDING_PART 0x1p-17f
#define EDGE_PART 0.1f
#define STEP_PART_MAX 0.25f
#define WHOLE_STEP 0.02f
#define OFF_STEP 0.2f
#define MOST 0.6f
#define OF_MOST 0.39639f
#define LEAST_QUARTER (0.15793f / 1.4f)
#define NOISE_SHAPE 9.0f
#define NOISE_FALL 1.15f
#define NOISE_CHANCE 4.0f
#define FIT_CLOSE 0.02f
#define FIT_SIMPLER 0.03f
#define FIT_TIE 1e-6f       /* fits that differ by less are as close */
#define FIT_RIDGE 1e-9f     /* share of a term's square: with less, others tell as much */
#define NOISE_MAX 1e18f

typedef struct {
    int counts[2][NOISE_RANGES][NOISE_SIZES]; /* of differences: of neighbours, of samples two apart */
    int every[NOISE_RANGES], levels[NOISE_RANGES], sums[NOISE_RANGES]; /* cells; without a change; their nearness */
    int nearest, known, smooth, high, farthest, changes, steep, whole;
    int ones, gaps, whole_gaps, near_one, below, number, half_steps, unused;
    int stairs_of[NOISE_ITEMS], steep_of[NOISE_ITEMS];
    int total[NOISE_RANGES];
    float near_by[NOISE_RANGES], far_by[NOISE_RANGES];
    float at[NOISE_RANGES], size[NOISE_RANGES], share[NOISE_RANGES]; /* what is fitted */
    float fits[7][4];                                                /* a, b, c, and how far off they are */
    float places[NOISE_STAIRS], ratios[NOISE_STAIRS];
} NoiseTables;

#define CLEARED (2 * NOISE_RANGES * NOISE_SIZES + 3 * NOISE_RANGES) /* before `nearest` */

/* The work, as a work-item sees it */
typedef struct {
    global NoiseTables *t;
    global float *strips; /* (3, stride) nearness, NaN where there is none */
    int stride, item, items;
} Estimate;

#if LANES == 1
#define MEET barrier(CLK_GLOBAL_MEM_FENCE);
#define ADD_TO(place, value) atomic_add(place, value)
#define RAISE_TO(place, value) atomic_max(place, value)
#else
#define MEET
#define ADD_TO(place, value) (*(place) += (value))
#define RAISE_TO(place, value) (*(place) = max(*(place), (int)(value)))
#endif
#define OWN_PACKETS(e, i, end) (int i = (e).item * LANES; i < (end); i += (e).items * LANES)
#define STRIDE_OF(count) (((count) / LANES + 2) * LANES) /* with room for a packet that begins at the end */
#define LANES_OF(mask) (int)popcount(lane_bits(mask))

INLINED float sum_of_lanes(floatl v)
{
    float sum = 0.0f;
    for (int lane = 0; lane < LANES; lane++)
        sum += float_lane(v, lane);
    return sum;
}

INLINED void clear_ints(Estimate e, global int *values, int count)
{
    for OWN_PACKETS (e, i, count)
        store_lanes((intl)0, values + i);
}

INLINED int strips_of(int cells, int length, int lines)
{
    return min((cells + 2 * length - 1) / (2 * length), max(lines - 2, 0));
}

/* Copies strips of three lines, each with two zeros behind it. */
INLINED void copy_strips(Estimate e, global const float *depth, int along, int across, int count, int length, int lines,
                         global float *to)
{
    const int total = lines - 2;
    for (int strip = 0; strip < count; strip++, to += length + 2) {
        const int line = count == total ? strip : (int)mul_hi((uint)strip * GOLDEN_PART, (uint)total);
        global const float *from = depth + (size_t)line * across;
        for (int i = e.item; i < length + 2; i += e.items)
            for (int k = 0; k < 3; k++)
                to[k * e.stride + i] = i < length ? from[(size_t)i * along + (size_t)k * across] : 0.0f;
    }
}

/* Copies strips of every `gap`-th row and column, as depths. */
OUTLINED int gather_strips(Estimate e, global const float *depth, int width, int height, int gap, int cells)
{
    const int w = (width + gap - 1) / gap, h = (height + gap - 1) / gap;
    const int rows = strips_of(cells, w, h), columns = strips_of(cells, h, w);
    const int in_rows = rows * (w + 2), count = in_rows + columns * (h + 2);
    e.stride = STRIDE_OF(count);
    copy_strips(e, depth, gap, gap * width, rows, w, h, e.strips);
    copy_strips(e, depth, gap * width, gap, columns, h, w, e.strips + in_rows);
    for (int i = count + e.item; i < e.stride; i += e.items)
        for (int k = 0; k < 3; k++)
            e.strips[k * e.stride + i] = 0.0f;
    return count;
}

#define IS_SAMPLE(z) (((z) > 1e-37f) & ((z) < far))

INLINED void find_nearest(Estimate e, float far)
{
    floatl least = INFINITY;
    for OWN_PACKETS (e, i, 3 * e.stride) {
        const floatl z = load_lanes(e.strips + i);
        least = min_lanes(select_lanes(IS_SAMPLE(z), z, (floatl)INFINITY), least);
    }
    RAISE_TO(&e.t->nearest, as_int(INFINITY) - as_int(least_lane(least)));
}

/* The unit of depth */
INLINED float noise_unit(Estimate e)
{
    return e.t->nearest ? as_float((as_int(INFINITY) - e.t->nearest) & as_int(INFINITY)) : 1.0f;
}

INLINED void to_noise_unit(Estimate e, float far)
{
    const float unit = noise_unit(e);
    for OWN_PACKETS (e, i, 3 * e.stride) {
        const floatl z = load_lanes(e.strips + i);
        store_lanes(select_lanes(IS_SAMPLE(z), unit / z, (floatl)NAN), e.strips + i);
    }
}

/* Cells of 2 x 2 samples: mean nearness (NaN if one is missing), the difference of the differences along the lines, and
 * the largest difference of neighbours. */
typedef struct {
    floatl near, change, largest;
} NoiseCells;

INLINED NoiseCells noise_cells(Estimate e, int gap, int i)
{
    global const float *upper = e.strips + i, *lower = upper + gap * e.stride;
    const floatl a = load_lanes(upper), b = load_lanes(upper + gap), c = load_lanes(lower), d = load_lanes(lower + gap);
    const floatl above = b - a, below = d - c;
    const NoiseCells cells = {0.25f * (b + a + d + c), fabs(above - below),
                              max_lanes(max_lanes(fabs(above), fabs(below)), fabs(d - b))};
    return cells;
}

#define RANGE_OF(near) clamp(NEAREST_RANGE - (as_int(near) >> 21), 0, NOISE_RANGES - 1)

OUTLINED void count_cells(Estimate e)
{
    int known = 0, smooth = 0;
    floatl low = INFINITY, high = 0.0f;
    for OWN_PACKETS (e, i, e.stride - LANES) {
        const NoiseCells cells = noise_cells(e, 1, i);
        known += LANES_OF(cells.near > 0.0f);
        smooth += LANES_OF(cells.largest < EDGE_PART * cells.near);
        low = min_lanes(cells.near, low);
        high = max_lanes(cells.near, high);
    }
    const float least = least_lane(low), greatest = -least_lane(-high);
    ADD_TO(&e.t->known, known);
    ADD_TO(&e.t->smooth, smooth);
    RAISE_TO(&e.t->high, as_int(greatest));
    RAISE_TO(&e.t->farthest, RANGE_OF(least));
}

INLINED void add_size(Estimate e, int kind, int range, float size)
{
    ADD_TO(&e.t->counts[kind][range][clamp((as_int(size) >> 20) - LEAST_SIZE, 0, LAST_SIZE)], 1);
}

#define SUM_SHIFT(e) max(21 - (int)clz(2 * (e).stride), 0) /* so that sums of `stride` samples hold in 32 bits */

INLINED void add_place(Estimate e, int range, float near)
{
    ADD_TO(&e.t->every[range], 1);
    ADD_TO(&e.t->sums[range], (as_int(near) & 0x1FFFFF) >> SUM_SHIFT(e));
}

/* The depth at the mean nearness of a range */
INLINED float range_depth(Estimate e, int range)
{
    const float mean = (float)(uint)e.t->sums[range] / (float)e.t->every[range] * (float)(1 << SUM_SHIFT(e));
    return 1.0f / as_float(((NEAREST_RANGE - range) << 21) + (int)mean);
}

/* Counts differences by their range of nearness and their size as a part of it. */
OUTLINED void count_differences(Estimate e)
{
    const int all = 10 * e.t->smooth < e.t->known; /* their noise is as large */
    const int first = RANGE_OF(as_float(e.t->high)), last = e.t->farthest;
    for OWN_PACKETS (e, i, e.stride - LANES) {
        const NoiseCells one = noise_cells(e, 1, i), two = noise_cells(e, 2, i);
        const intl smooth = one.largest < EDGE_PART * one.near;
        const floatl one_size = one.change / one.near, two_size = two.change / two.near;
        for (int lane = 0; lane < LANES; lane++) {
            const float near = float_lane(one.near, lane), near_2 = float_lane(two.near, lane);
            if (near > 0.0f) {
                const int range = RANGE_OF(near);
                add_place(e, range, near);
                ADD_TO(&e.t->levels[range], float_lane(one.largest, lane) == 0.0f);
                if (all || int_lane(smooth, lane))
                    add_size(e, 0, range, float_lane(one_size, lane));
            }
            if (near_2 > 0.0f)
                add_size(e, 1, clamp(RANGE_OF(near_2), first, last), float_lane(two_size, lane));
        }
    }
}

/* Mean of the smallest sizes, such a share of them: quantiles of noise in steps would be those of the steps. */
INLINED float mean_below(global const int *counts, int total, float share)
{
    const float wanted = share * (float)total;
    float before = 0.0f, sum = 0.0f;
    for (int i = 0; i <= LAST_SIZE && before < wanted; i++) {
        const float size = i ? as_float((2 * (LEAST_SIZE + i) + 1) << 19) : 0.0f, here = (float)counts[i];
        sum += min(wanted - before, here) * size;
        before += here;
    }
    return total ? sum / wanted : 0.0f;
}

/* Standard deviation of differences, as a part of the nearness. Equal ones tell against noise, but on a scale. */
INLINED float deviation_of(global const int *counts, int on_scale)
{
    int total = 0;
    for (int i = 0; i <= LAST_SIZE; i++)
        total += counts[i];
    const float most = mean_below(counts, total, MOST) / OF_MOST;
    return 0.5f * (on_scale ? most : min(most, mean_below(counts, total, 0.25f) / LEAST_QUARTER));
}

INLINED void begin_fit(Estimate e, int number)
{
    e.t->number = number;
    for (int i = number; i < (number + LANES - 1) / LANES * LANES; i++) {
        e.t->at[i] = e.t->size[i] = 1.0f;
        e.t->share[i] = 0.0f;
    }
}
#define ADD_TO_FIT(e, i, depth, deviation, count)                                                              \
    if ((deviation) > 0.0f) {                                                                                  \
        (e).t->at[i] = depth;                                                                                  \
        (e).t->size[i] = deviation;                                                                            \
        (e).t->share[i++] = (float)(count);                                                                    \
    }

/* Fits one choice of terms: least differences, by weighted squares in three rounds. What is left of a term beside those
 * before it is orthogonal to them (Gram-Schmidt), so that single precision is enough. */
OUTLINED void fit_choice(global NoiseTables *t, int choice)
{
    const int packets = (t->number + LANES - 1) / LANES, terms = FIT_CHOICES >> 4 * choice & 7;
    floatl columns[4][NOISE_RANGES / LANES], weights[NOISE_RANGES / LANES], off = 0.0f, all = 0.0f;
    float x[3] = {0.0f, 0.0f, 0.0f}, parts[3][4];
    int told = 1;
    for (int round = 0; round < 3; round++) {
        floatl full[3] = {0.0f, 0.0f, 0.0f};
        for (int i = 0; i < packets; i++) {
            const floatl z = load_lanes(t->at + i * LANES), inverse = 1.0f / load_lanes(t->size + i * LANES);
            const floatl share = load_lanes(t->share + i * LANES);
            weights[i] = share / (round ? max_lanes(fabs(columns[3][i]), FIT_CLOSE) : (floatl)1.0f);
            columns[0][i] = z * z * inverse;
            columns[1][i] = z * inverse;
            columns[2][i] = inverse;
            columns[3][i] = 1.0f;
            for (int term = 0; term < 3; term++)
                full[term] += weights[i] * columns[term][i] * columns[term][i];
        }
        for (int term = 0; term < 3; term++) {
            if (!(terms >> term & 1))
                continue;
            floatl products[4] = {0.0f, 0.0f, 0.0f, 0.0f};
            for (int i = 0; i < packets; i++)
                for (int other = term; other < 4; other++)
                    products[other] += weights[i] * columns[term][i] * columns[other][i];
            const float square = sum_of_lanes(products[term]);
            told &= square > FIT_RIDGE * sum_of_lanes(full[term]);
            for (int other = term + 1; other < 4; other++) {
                const float part = parts[term][other] = sum_of_lanes(products[other]) / square;
                for (int i = 0; i < packets; i++)
                    columns[other][i] -= part * columns[term][i];
            }
        }
    }
    for (int term = 2; term >= 0; term--)
        if (terms >> term & 1) {
            x[term] = parts[term][3];
            for (int other = term + 1; other < 3; other++)
                x[term] -= parts[term][other] * x[other];
        }
    for (int i = 0; i < packets; i++) {
        const floatl share = load_lanes(t->share + i * LANES);
        off += fabs(columns[3][i]) * share;
        all += share;
    }
    told &= x[0] >= 0.0f && x[1] >= 0.0f && x[2] >= 0.0f;
    const float by = sum_of_lanes(off) / sum_of_lanes(all) + FIT_SIMPLER * (float)popcount(terms);
    vstore4((float4)(x[0], x[1], x[2], told ? by : INFINITY), choice, &t->fits[0][0]);
}

/* (a, b, c) that fits best, none negative; terms that add little are 0. */
INLINED float4 fitted(Estimate e)
{
    MEET
    for (int choice = e.item; choice < 7; choice += e.items)
        fit_choice(e.t, choice);
    MEET
    float4 best = {0.0f, 0.0f, 0.0f, INFINITY};
    for (int choice = 0; choice < 7; choice++) {
        const float4 fit = vload4(choice, &e.t->fits[0][0]);
        if (fit.w < best.w - FIT_TIE)
            best = fit;
    }
    return best;
}

/* Of nearness: the deviation, or the step, that (a, b, c) is of depth */
#define IN_NEARNESS(abc, near) ((abc).x + ((abc).y + (abc).z * (near)) * (near))

/* (a, b, c) of the deviation, at least half a step */
INLINED float4 deviation_by_cells(Estimate e, float4 steps)
{
    const int on_scale = steps.x > 0.0f || steps.y > 0.0f || steps.z > 0.0f;
    const float4 half_ = 0.5f * steps;
    global NoiseTables *t = e.t;
    if (t->known < CELLS_MIN)
        return half_;
    count_differences(e);
    MEET
    for (int range = e.item; range < NOISE_RANGES; range += e.items) {
        int total = 0;
        for (int i = 0; t->every[range] && i <= LAST_SIZE; i++)
            total += t->counts[0][range][i];
        t->total[range] = total;
        if (total >= CELLS_MIN) {
            t->near_by[range] = deviation_of(t->counts[0][range], on_scale);
            t->far_by[range] = deviation_of(t->counts[1][range], on_scale);
        }
    }
    MEET
    if (e.item == 0) {
        int smooth_ranges = 0, all = 0, equal = 0, number = 0;
        float most = INFINITY;
        for (int pass = 0; pass < 2; pass++)
            for (int range = NOISE_RANGES - 1; range >= 0; range--) { /* from far to near */
                const int total = t->total[range], is_smooth = 5 * total >= 4 * t->every[range];
                /* Equal samples, as a sky's, tell nothing about the noise of others; nor do ranges with many edges. */
                if (total < CELLS_MIN || !(on_scale || 4 * t->levels[range] < total))
                    continue;
                smooth_ranges += is_smooth;
                if (pass == 0 || (smooth_ranges && !is_smooth))
                    continue;
                const float z = range_depth(e, range), near_by = t->near_by[range] * z, far_by = t->far_by[range] * z;
                /* Curves do not count: their differences grow with the square of the distance. */
                const float square = (NOISE_SHAPE * near_by * near_by - far_by * far_by) / (NOISE_SHAPE - 1.0f);
                float deviation = sqrt(max(square, 0.0f));
                all += total;
                equal += square > 0.0f ? 0 : total;
                deviation = max(min(deviation, most), half_.z + (half_.y + half_.x * z) * z);
                most = min(most, near_by * (NOISE_FALL + NOISE_CHANCE / sqrt((float)total)));
                ADD_TO_FIT(e, number, z, deviation, total)
            }
        t->half_steps = 2 * equal >= all;
        begin_fit(e, number);
    }
    const float4 found = fitted(e);
    return t->half_steps ? half_ : found;
}

/* Triples of samples along the first line, or at `stride` and beyond across the lines: the middle's nearness, the jump
 * there, the lesser difference, and whether both differ by a step or more. */
typedef struct {
    floatl here, jump, least;
    intl is_stair, is_steep, is_change;
} Triples;

INLINED Triples triples_at(Estimate e, int i)
{
    const int across = i >= e.stride, next = across ? e.stride : 1;
    global const float *first = e.strips + i - across * e.stride;
    const floatl here = load_lanes(first + next), one = here - load_lanes(first);
    const floatl other = load_lanes(first + 2 * next) - here, jump = fabs(one - other);
    const floatl least = min_lanes(fabs(one), fabs(other));
    const intl change = (jump > ROUNDING_PART * here) & (jump < STEP_PART_MAX * here);
    const Triples made = {here, jump, least, change & (least == 0.0f),
                          change & (least > 0.0f) & ((one > 0.0f) == (other > 0.0f)), change};
    return made;
}

#define OWN_TRIPLES(e, i)                                                                                      \
    (int i = (e).item * SHARE_OF(e); i < min(((e).item + 1) * SHARE_OF(e), 2 * (e).stride - LANES); i += LANES)
#define SHARE_OF(e) ((2 * (e).stride / LANES + (e).items - 1) / (e).items * LANES) /* neighbours, in their order */

OUTLINED void count_stairs(Estimate e)
{
    int changes = 0, stairs = 0, steep = 0, whole = 0;
    for OWN_TRIPLES (e, i) {
        const Triples at = triples_at(e, i);
        const floatl steps = at.least / at.jump;
        changes += LANES_OF(at.is_change);
        stairs += LANES_OF(at.is_stair);
        steep += LANES_OF(at.is_steep);
        whole += LANES_OF(at.is_steep & (fabs(steps - floor_lanes(steps + 0.5f)) < WHOLE_STEP));
    }
    ADD_TO(&e.t->changes, changes);
    ADD_TO(&e.t->steep, steep);
    ADD_TO(&e.t->whole, whole);
    e.t->stairs_of[e.item] = stairs;
    e.t->steep_of[e.item] = steep;
}

/* Keeps each `every`-th stair and counts its jump; `rank`: number of stairs before the work-item's own. */
OUTLINED void keep_stairs(Estimate e, int with_steep, int every, int rank)
{
    for OWN_TRIPLES (e, i) {
        const Triples at = triples_at(e, i);
        for (uint bits = lane_bits(at.is_stair | (with_steep ? at.is_steep : 0)); bits; bits = WITHOUT_LOWEST(bits), rank++)
            if (rank % every == 0) {
                const float place = float_lane(at.here, LOWEST(bits)), jump = float_lane(at.jump, LOWEST(bits));
                e.t->places[rank / every] = place;
                e.t->ratios[rank / every] = jump;
                add_place(e, RANGE_OF(place), place);
                add_size(e, 0, RANGE_OF(place), jump / place);
            }
    }
}

/* Sorts `count` values, a power of two of at least LANES, by a bitonic network. */
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

INLINED void measure_ratios(Estimate e, int count, int room, float4 steps)
{
    for OWN_PACKETS (e, i, room) {
        const floatl place = load_lanes(e.t->places + i), ratio = load_lanes(e.t->ratios + i) / IN_NEARNESS(steps, place);
        const intl kept = i + lane_index < count;
        store_lanes(select_lanes(kept, place, (floatl)INFINITY), e.t->places + i);
        store_lanes(select_lanes(kept, ratio, (floatl)INFINITY), e.t->ratios + i);
    }
}

/* (a, b, c) of a scale's steps, zeros if there is none: there surfaces are stairs, whose samples equal one neighbour and
 * differ from the other, mostly by one step. */
INLINED float4 steps_by_stairs(Estimate e)
{
    global NoiseTables *t = e.t;
    const float4 none = 0.0f;
    count_stairs(e);
    MEET
    /* On a scale steep surfaces rise by whole steps. */
    const int with_steep = 10 * t->whole > 9 * t->steep;
    int count = 0, rank = 0;
    for (int i = 0; i < e.items; i++) {
        const int own = t->stairs_of[i] + (with_steep ? t->steep_of[i] : 0);
        rank += i < e.item ? own : 0;
        count += own;
    }
    if (100 * count <= t->changes)
        return none;
    const int every = count / NOISE_STAIRS_MAX + 1, kept = (count + every - 1) / every;
    keep_stairs(e, with_steep, every, rank);
    MEET
    if (e.item == 0) {
        int number = 0;
        for (int range = 0; range < NOISE_RANGES; range++)
            if (t->every[range]) {
                const float z = range_depth(e, range);
                ADD_TO_FIT(e, number, z, mean_below(t->counts[0][range], t->every[range], 0.25f) * z, t->every[range])
            }
        begin_fit(e, number);
    }
    float4 steps = fitted(e);
    int room = LANES;
    while (room < kept)
        room *= 2;
    clear_ints(e, &t->counts[0][0][0], CLEARED); /* for what comes next */
    measure_ratios(e, kept, room, steps);
    MEET
    sort_values(e, t->places, room);
    sort_values(e, t->ratios, room);
    int below = 0, near_one = 0, ones = 0, gaps = 0, whole = 0;
    for OWN_PACKETS (e, i, kept) {
        const floatl ratio = load_lanes(t->ratios + i);
        below += LANES_OF(ratio <= 0.5f);
        near_one += LANES_OF((ratio > 0.5f) & (ratio < 1.5f));
    }
    ADD_TO(&t->below, below);
    ADD_TO(&t->near_one, near_one);
    MEET
    const int middle = t->below + t->near_one / 2;
    const float exact = !t->near_one ? 1.0f : t->near_one & 1 ? t->ratios[middle]
                                            : 0.5f * (t->ratios[middle - 1] + t->ratios[middle]);
    steps *= exact;
    for OWN_PACKETS (e, i, kept) {
        const floatl place = load_lanes(t->places + i + 1), ratio = load_lanes(t->ratios + i);
        const floatl gap = place - load_lanes(t->places + i);
        const intl apart = (gap > 0.0f) & (i + 1 + lane_index < kept);
        const floatl number = gap / IN_NEARNESS(steps, place);
        ones += LANES_OF(fabs(ratio / exact - 1.0f) < OFF_STEP);
        gaps += LANES_OF(apart);
        whole += LANES_OF(apart & (number > OFF_STEP) & (fabs(number - floor_lanes(number + 0.5f)) < OFF_STEP));
    }
    ADD_TO(&t->ones, ones);
    ADD_TO(&t->gaps, gaps);
    ADD_TO(&t->whole_gaps, whole);
    MEET
    const int is_scale = t->gaps + 1 >= LEVELS_MIN && 5 * t->ones >= 3 * kept && 5 * t->whole_gaps >= 3 * t->gaps;
    return is_scale ? steps : none;
}

/* Estimates by `items` work-items of a group, NOISE_ITEMS at most, all of which call it. */
OUTLINED void estimate_noise(global const float *depth, int width, int height, float far, int cells, global int *tables,
                             global float *noise, int item, int items)
{
    global NoiseTables *t = (global NoiseTables *)tables;
    Estimate e = {t, (global float *)(t + 1), 0, item, items};
    for (int gap = 1; gap <= 2; gap++) {
        clear_ints(e, tables, CLEARED + 16);
        const int count = gather_strips(e, depth, width, height, gap, cells);
        e.stride = STRIDE_OF(count);
        MEET
        find_nearest(e, far);
        MEET
        to_noise_unit(e, far);
        MEET
        count_cells(e);
        MEET
        if (10 * t->known >= count)
            break;
        MEET /* every other sample is missing: lines are two apart */
    }
    const float4 steps = steps_by_stairs(e), deviation = deviation_by_cells(e, steps);
    if (item == 0) {
        const float unit = noise_unit(e);
        vstore3(fmin((float3)(deviation.x / unit, deviation.y, deviation.z * unit), NOISE_MAX), 0, noise);
        vstore3(fmin((float3)(steps.x / unit, steps.y, steps.z * unit), NOISE_MAX), 1, noise);
    }
}

kernel void find_noise(global const float *depth, global int *tables, global float *noise, int width, int height,
                       float far, int cells)
{
    estimate_noise(depth, width, height, far, cells, tables, noise, get_local_id(0) + get_local_id(1) * get_local_size(0),
                   get_local_size(0) * get_local_size(1));
}
