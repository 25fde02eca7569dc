/* Continues texture into filled holes by patches of the same surface: the search of PatchMatch (Barnes, Shechtman,
 * Finkelstein, Goldman 2009) and the vote of Wexler, Shechtman and Irani (2007) in turn, from coarse to fine.
 * Deviations: a source is a patch of known pixels at about the hole's filled depth, without a jump to nearer surface
 * in it or beside it. Foreground beside a hole takes no part in comparisons. A hash of pixel and launch replaces
 * random numbers, and matches are propagated from the last launch only. Targets are holes, and known pixels whose
 * patches contain holes. In the end, mark_matches finds how well sources predict the known pixels of targets; where
 * they predict badly, as in clutter, show_patches keeps the filled colour.
 *
 * color, depth, valid: (height, width) of the picture. Arrays of a level have `pitch` columns, and PAD more pixels
 * than its picture on every side. image: 4 floats for each pixel, its colour (the maximum is 1) and its place: the
 * logarithm of a perspective depth, otherwise depth * per_depth. filled: the colours before the first vote. planes:
 * HOLES and KNOWN, the places of holes and of known pixels, -INFINITY elsewhere; WEIGHTS of pixels in comparisons;
 * NEAREST_PLACE in a source, -INFINITY for pixels that are no sources; COSTS of matches. field, from, to: the pixels'
 * matches. marks: 3 bytes for each pixel, from 0 for the filled colour to 255 for the patches' colour. Work-item:
 * `strip` times LANES pixels of a row, which compares four pixels of a patch at once. Cost: O(pixels), and some 20
 * comparisons of patches for each target of the finest level. Determinism: no work-item reads what another one writes.
 */
#include "lib/channel.h"
#include "lib/lanes.h"

#define PAD 8              /* pixels */
#define PATCH_BEFORE 4     /* pixels of a patch to the left of its centre, and above it */
#define PATCH_SIDE 8       /* pixels */
#define SAME_PLACE 0.1f    /* difference in depth within a surface */
#define HOLE_WEIGHT 0.2f   /* weight of holes in comparisons; known pixels weigh 1 */
#define FILLED_WEIGHT 3.0f /* weight of the difference between a source's mean colour and the filled colour */
#define COST_FLOOR 0.003f  /* added to costs when patches vote */
#define INVISIBLE 0.002f   /* squared difference of two colours that look the same */
#define NO_TARGET -2
#define NO_MATCH -1

#define HOLES 0
#define KNOWN 1
#define WEIGHTS 2
#define NEAREST_PLACE 3
#define COSTS 4
#define PLANE(name) (planes + name * (size_t)pitch * (height + 2 * PAD))
#define AT_LEVEL(x, y) (((y) + PAD) * pitch + (x) + PAD)
#define EACH_PIXEL(x, y, columns, rows)                                                                        \
    for (int x = get_global_id(0) * strip * LANES, y = get_global_id(1), end = min(x + strip * LANES, columns); \
         x < end && y < (rows); x++)
#define EACH_OF_PATCH(shift)                                                                                   \
    for (int v = -PATCH_BEFORE, shift; v < PATCH_SIDE - PATCH_BEFORE; v++)                                     \
        for (int u = -PATCH_BEFORE; shift = v * pitch + u, u < PATCH_SIDE - PATCH_BEFORE; u++)
#define SUM_OF_COLOR(v) ((v).x + (v).y + (v).z)
#define SUM_OF_FOUR(v) (SUM_OF_COLOR(v) + (v).w)

#define PIXELS_OF_PATCH(pixel) vload16(0, image + 4 * (size_t)(pixel))
#define SUM_OF_PIXELS(v) ((v).lo.lo + (v).lo.hi + (v).hi.lo + (v).hi.hi)

void begin_pixel(global float *image, global float *planes, int height, int pitch, int at, float4 own, int inside,
                 int hole)
{
    vstore4(own, at, image);
    PLANE(KNOWN)[at] = inside && !hole ? own.w : -INFINITY;
    PLANE(HOLES)[at] = inside && hole ? own.w : -INFINITY;
    PLANE(WEIGHTS)[at] = 0.0f; /* in the padding; find_targets writes weights and sources of the picture */
    PLANE(NEAREST_PLACE)[at] = -INFINITY;
}

kernel void begin_level(global const channel *color, global const float *depth, global const uchar *valid, int width,
                        int height, int pitch, int strip, int perspective, float per_depth, global float *image,
                        global float *planes)
{
    EACH_PIXEL(column, row, pitch, height + 2 * PAD) {
        const int x = column - PAD, y = row - PAD, inside = x >= 0 && y >= 0 && x < width && y < height;
        const size_t pixel = inside ? (size_t)y * width + x : 0;
        const float z = depth[pixel], place = perspective ? log(z) : z * per_depth;
        const float4 own = (float4)(color[3 * pixel], color[3 * pixel + 1], color[3 * pixel + 2], 0.0f) / CHANNEL_MAX;
        begin_pixel(image, planes, height, pitch, row * pitch + column, (float4)(own.xyz, place), inside,
                    !valid[pixel]);
    }
}

/* Makes a level of half the width and height. A pixel is a hole if most of its four are. */
kernel void halve_level(global const float *fine_image, global const float *fine_planes, int fine_pitch, int width,
                        int height, int pitch, int strip, global float *image, global float *planes)
{
    EACH_PIXEL(column, row, pitch, height + 2 * PAD) {
        const int x = column - PAD, y = row - PAD, inside = x >= 0 && y >= 0 && x < width && y < height;
        float4 sum = 0.0f;
        int holes = 0;
        for (int i = 0; inside && i < 4; i++) {
            const int at = (2 * y + i / 2 + PAD) * fine_pitch + 2 * x + i % 2 + PAD;
            sum += vload4(at, fine_image);
            holes += fine_planes[at] > -INFINITY;
        }
        begin_pixel(image, planes, height, pitch, row * pitch + column, sum / 4, inside, holes > 2);
    }
}

/* Finds targets, weights and sources. edge: a source's margin of known pixels that are not nearer */
kernel void find_targets(int width, int height, int pitch, int strip, int edge, global float *planes, global int *field)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1), end = PATCH_SIDE - PATCH_BEFORE;
    for (int x = first; x < min(first + strip * LANES, width) && y < height; x += LANES) {
        const int at = AT_LEVEL(x, y);
        /* the nearest known pixel around, and the farthest hole in the patch */
        floatl nearest = INFINITY, farthest = -INFINITY;
        for (int v = -PATCH_BEFORE - edge; v < end + edge; v++)
            for (int u = -PATCH_BEFORE - edge; u < end + edge; u++) {
                nearest = min_lanes(nearest, load_lanes(PLANE(KNOWN) + at + v * pitch + u));
                if (u >= -PATCH_BEFORE && v >= -PATCH_BEFORE && u < end && v < end)
                    farthest = max_lanes(farthest, load_lanes(PLANE(HOLES) + at + v * pitch + u));
            }
        const intl is_foreground = load_lanes(PLANE(KNOWN) + at) < farthest - SAME_PLACE;
        const floatl of_known = select_lanes(is_foreground, (floatl)0.0f, (floatl)1.0f);
        const intl is_hole = load_lanes(PLANE(HOLES) + at) > -INFINITY;
        const floatl weights = select_lanes(is_hole, (floatl)HOLE_WEIGHT, of_known);
        store_first(weights, PLANE(WEIGHTS) + at, width - x);
        store_first(nearest, PLANE(NEAREST_PLACE) + at, width - x);
        uint targets = lane_bits((weights > 0.0f) & (farthest > -INFINITY) & (x + lane_index < width));
        for (; targets; targets = WITHOUT_LOWEST(targets))
            field[at + LOWEST(targets)] = NO_MATCH;
    }
}

/* Does the patch around s show the surface at this place in depth? */
int is_source(global const float *image, global const float *nearest, int s, float place)
{
    return nearest[s] >= place - SAME_PLACE && image[4 * (size_t)s + 3] <= place + SAME_PLACE;
}

/* Takes matches from the level of half the width and height, where they are sources. */
kernel void refine_matches(global const float *image, global float *planes, int width, int height, int pitch, int strip,
                           global const int *coarse, int coarse_pitch, global int *field)
{
    EACH_PIXEL(x, y, width, height) {
        const int t = AT_LEVEL(x, y), match = coarse[(y / 2 + PAD) * coarse_pitch + x / 2 + PAD];
        if (field[t] == NO_TARGET || match < 0)
            continue;
        const int u = 2 * (match % coarse_pitch - PAD) + x % 2, v = 2 * (match / coarse_pitch - PAD) + y % 2;
        if (!is_source(image, PLANE(NEAREST_PLACE), AT_LEVEL(u, v), image[4 * (size_t)t + 3]))
            continue;
        field[t] = AT_LEVEL(u, v);
        PLANE(COSTS)[t] = 0.0f; /* the first patches weigh the same */
    }
}

/* Makes s the match of target t if it is a source with less cost. wanted: the filled colour, and the weight of its
 * difference from the source's mean */
INLINED void try_source(int s, int t, global const float *image, global const float *planes, int height, int pitch,
                        float4 wanted, int *match, float *least)
{
    if (s == *match || !is_source(image, PLANE(NEAREST_PLACE), s, image[4 * (size_t)t + 3]))
        return;
    float16 sum = 0.0f, mean = 0.0f;
    for (int v = -PATCH_BEFORE; v < PATCH_SIDE - PATCH_BEFORE; v++) {
        for (int u = -PATCH_BEFORE; u < PATCH_SIDE - PATCH_BEFORE; u += 4) {
            const int shift = v * pitch + u;
            const float16 there = PIXELS_OF_PATCH(s + shift), difference = PIXELS_OF_PATCH(t + shift) - there;
            const float4 w = vload4(0, PLANE(WEIGHTS) + t + shift);
            mean += there;
            sum += (float16)(w.xxxx, w.yyyy, w.zzzz, w.wwww) * difference * difference;
        }
        if (v == -1 && SUM_OF_FOUR(SUM_OF_PIXELS(sum)) >= *least)
            return;
    }
    const float4 off = wanted - SUM_OF_PIXELS(mean) / (PATCH_SIDE * PATCH_SIDE), squares = off * off;
    const float cost = SUM_OF_FOUR(SUM_OF_PIXELS(sum)) + wanted.w * SUM_OF_COLOR(squares);
    *match = cost < *least ? s : *match;
    *least = fmin(cost, *least);
}

uint hashed(uint x)
{
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

/* Improves matches by the matches of neighbours, `jump` pixels away, and by random sources within `radius` pixels of
 * the best match, half of it, and so on. guide: weight of a source's difference in mean colour from the filled one */
kernel void search_patches(global const float *image, global float *planes, global const float *filled, int width,
                           int height, int pitch, int strip, int jump, int radius, int number, float guide,
                           global const int *from, global int *to)
{
    EACH_PIXEL(x, y, width, height) {
        const int t = AT_LEVEL(x, y);
        if (from[t] == NO_TARGET)
            continue;
        const float4 wanted = (float4)(vload4(t, filled).xyz, guide);
        float least = INFINITY;
        int match = NO_MATCH;
        for (int i = 0; i < 5; i++) {
            const int beside = i < 3 ? (i - 1) * jump : (2 * i - 7) * jump * pitch;
            if (from[t + beside] >= 0)
                try_source(from[t + beside] - beside, t, image, planes, height, pitch, wanted, &match, &least);
        }
        uint random = hashed(number * 0x9e3779b9u ^ t);
        for (int r = radius; r >= 1; r /= 2) {
            const int center = match >= 0 ? match : t;
            random = hashed(random);
            const int u = center % pitch - PAD + (int)((random & 0xffff) % (2 * r + 1)) - r;
            const int v = center / pitch - PAD + (int)((random >> 16) % (2 * r + 1)) - r;
            const int s = AT_LEVEL(clamp(u, 0, width - 1), clamp(v, 0, height - 1));
            try_source(s, t, image, planes, height, pitch, wanted, &match, &least);
        }
        to[t] = match;
        PLANE(COSTS)[t] = least;
    }
}

/* Gives each hole the weighted mean of the patches over it; patches weigh more if they match better. */
kernel void vote(global float *image, global const float *planes, int width, int height, int pitch, int strip,
                 global const int *field)
{
    EACH_PIXEL(x, y, width, height) {
        const int p = AT_LEVEL(x, y);
        float4 sum = 0.0f;
        float total = 0.0f;
        if (!(PLANE(HOLES)[p] > -INFINITY))
            continue;
        EACH_OF_PATCH(shift) {
            const int match = field[p - shift];
            if (match < 0)
                continue;
            const float cost = PLANE(COSTS)[p - shift] + COST_FLOOR, weight = PLANE(WEIGHTS)[p - shift] / (cost * cost);
            sum += weight * vload4(match + shift, image);
            total += weight;
        }
        if (total > 0.0f)
            vstore3(sum.xyz / total, 0, image + 4 * (size_t)p);
    }
}

/* Marks targets by how well their matches predict the known pixels of their patches: by the mean squared difference
 * over the variance. */
kernel void mark_matches(global const float *image, global const float *planes, int width, int height, int pitch,
                         int strip, global const int *field, global uchar *marks)
{
    EACH_PIXEL(x, y, width, height) {
        const int t = AT_LEVEL(x, y), match = field[t];
        float4 sum = 0.0f, squares = 0.0f, differences = 0.0f;
        float count = 0.0f;
        EACH_OF_PATCH(shift) {
            if (match < 0 || PLANE(WEIGHTS)[t + shift] < 1.0f)
                continue;
            const float4 own = vload4(t + shift, image), difference = own - vload4(match + shift, image);
            count += 1.0f;
            sum += own;
            squares += own * own;
            differences += difference * difference;
        }
        const float4 variances = squares - sum * sum / max(count, 1.0f);
        const float ratio = SUM_OF_COLOR(differences) / (SUM_OF_COLOR(variances) + INVISIBLE * count);
        const uchar mark = count > 0.0f ? convert_uchar_sat(255.0f * (2.2f - 2.0f * ratio)) : 0;
        vstore3((uchar3)(mark), (size_t)y * width + x, marks);
    }
}

/* Mixes the patches' colours with the filled ones by the marks that were spread into the holes. */
kernel void show_patches(global const float *image, global const float *planes, int width, int height, int pitch,
                         int strip, global const uchar *marks, global channel *color)
{
    EACH_PIXEL(x, y, width, height) {
        const size_t p = AT_LEVEL(x, y), pixel = (size_t)y * width + x;
        if (!(PLANE(HOLES)[p] > -INFINITY))
            continue;
        const float4 own = {color[3 * pixel], color[3 * pixel + 1], color[3 * pixel + 2], 0.0f};
        vstore3(to_channels(mix(own, vload4(p, image) * CHANNEL_MAX, marks[3 * pixel] / 255.0f)).xyz, pixel, color);
    }
}
