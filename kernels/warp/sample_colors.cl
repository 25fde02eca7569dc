/* Finds the colours of a depth image's samples in the picture of another camera, where that camera sees them.
 *
 * A sample is hidden if its pixel in the picture shows a nearer point of another surface. To tell whether sample and
 * point lie on one surface, the ray through both is walked in the depth image. They lie on different surfaces if the
 * ray passes an opening of the surface, or runs behind it by more than noise explains. A ray that grazes a noisy or
 * slanted surface does neither. A sample whose pixel shows nothing is hidden if its surface turns its back to the
 * camera. A colour is interpolated from four pixels, without those that show another surface. The other camera is a
 * pinhole whose pixels a lens may move (lib/lens.h): `map` leads to the pinhole's pixels.
 * places: with HAS_PLACES, (2, height, pitch) the samples' positions u and v in the source image, NaN for none. depth:
 * (height, width) of the samples, planar z; not finite, <= NEAREST or >= far means no depth. nearness: (src_height,
 * src_pitch) of the source image. shown, color: (dst_height, dst_width) the depth that the other camera sees, NaN for
 * none, and its picture. sample_color, seen: (height, width); colour is black where a sample is not seen. Work-item:
 * LANES samples of a row. Cost: O(samples), and for samples behind something nearer a walk over at most WALK_STEPS
 * samples. Determinism: samples are independent.
 */
#include "lib/color.h"
#include "lib/lens.h"
#include "lib/surface.h"
#include "lib/taps.h"

#ifndef HAS_PLACES
#define HAS_PLACES 0 /* 1: samples lie at `places` in the source image; 0: they are the image's own samples */
#endif
/* Distances between two points, in samples of the source: up to the first they lie on one surface, beyond the second on
 * two. In between, the ray between the points is walked. */
#define SAME_SURFACE 1.0f
#define WALK_STEPS 24
#define RELATIVE_TOLERANCE 1e-3f    /* a ray is behind a surface if its nearness is less by more than this fraction, */
#define OCCLUSION_DEVIATIONS 5.0f   /* plus this many standard deviations of the noise */
#define SLOPE_STEP 2          /* samples on each side over which slopes are measured; then over three times as many */
#define SLOPE_DEVIATIONS 3.0f /* standard deviations of the noise in the depths from which slopes are computed */

/* Does the Cut tear depths a <= b apart? Gives the same result as IS_OPEN, without divisions; false for NaN. */
#define ARE_TORN(perspective, cut, a, b)                                                                       \
    ((cut).near_scale * (b) - (cut).far_scale * (a) > (cut).least * ((perspective) ? (a) * (b) : (floatl)1.0f))

/* The noise's standard deviation at nearness q of the source: a + b q + c q^2 */
typedef struct {
    float a, b, c;
} Noise;

typedef struct {
    floatl u, v, q; /* pixel, and nearness */
} Point;

/* The source's nearness at (u, v): interpolated if the four samples around lie on one surface, else the nearest
 * one's */
INLINED floatl nearness_around(global const float *nearness, PixelMap map, Cut cut, floatl u, floatl v)
{
    const Taps taps = clamped_taps(map.src_width, map.src_height, u, v);
    const int beyond = map.src_pitch - map.src_width; /* a row's padding */
    floatl n[4], high = NO_SURFACE, low = INFINITY;
    for (int i = 0; i < 4; i++) {
        const intl row = i < 2 ? taps.row : min(taps.row + 1, (intl)(map.src_height - 1));
        n[i] = (floatl)(gather(nearness, taps.at[i] + row * beyond));
        high = max_lanes(n[i], high);
        low = min_lanes(n[i], low);
    }
    return select_lanes(IS_OPEN(cut, high, low), NEAREST_TAP(taps, n), bilinear(taps, n[0], n[1], n[2], n[3]));
}

/* Does another surface hide the sample? front: the point that the sample's pixel shows, in the source's pixel space */
INLINED intl is_occluded(global const float *nearness, PixelMap map, Cut cut, Noise noise, Point sample, Point front, intl active)
{
    const floatl du = front.u - sample.u, dv = front.v - sample.v;
    const floatl length = max_lanes(fabs(du), fabs(dv));
    const intl far_off = !(length <= (floatl)WALK_STEPS);
    const intl walks = active & !far_off & (length > SAME_SURFACE);
    const floatl count = ceil_lanes(select_lanes(walks, length, (floatl)0.0f));
    intl hidden = active & far_off;
    floatl before = sample.q;
    for (int step = 1; step <= WALK_STEPS && any_lane(walks & !hidden & (step <= count)); step++) {
        const floatl part = step / max_lanes(count, (floatl)1.0f);
        const floatl n = nearness_around(nearness, map, cut, sample.u + part * du, sample.v + part * dv);
        const intl known = walks & (step <= count) & (n > NO_SURFACE);
        const floatl ray = sample.q + part * (front.q - sample.q);
        const floatl tolerance = OCCLUSION_DEVIATIONS * (noise.a + n * (noise.b + n * noise.c)) + RELATIVE_TOLERANCE * fabs(n);
        hidden = hidden | (known & (IS_OPEN(cut, max_lanes(n, before), min_lanes(n, before)) | (n - ray > tolerance)));
        before = select_lanes(known, n, before);
    }
    return hidden;
}

/* The determinant of the 3 x 3 matrix with these columns: a point p, and columns i and j of the map m */
#define ORIENTATION(m, p, i, j)                                                                                \
    ((p)[0] * ((m)[4 + (i)] * (m)[8 + (j)] - (m)[8 + (i)] * (m)[4 + (j)]) -                                    \
     (p)[1] * ((m)[i] * (m)[8 + (j)] - (m)[8 + (i)] * (m)[j]) + (p)[2] * ((m)[i] * (m)[4 + (j)] - (m)[4 + (i)] * (m)[j]))

/* Does the surface around the sample turn its back to the target, by more than noise explains? */
INLINED intl faces_away(global const float *nearness, PixelMap map, Cut cut, Noise noise, Point sample, float aside)
{
    const float *D = map.dst_from_src;
    floatl slope[2], p[3];
    intl unknown = 0;
    for (int axis = 0; axis < 2; axis++) {
        const float x = axis ? 0.0f : aside, y = axis ? aside : 0.0f;
        const floatl low = nearness_around(nearness, map, cut, sample.u - x, sample.v - y);
        const floatl high = nearness_around(nearness, map, cut, sample.u + x, sample.v + y);
        const intl none_low = IS_OPEN(cut, max_lanes(low, sample.q), min_lanes(low, sample.q));
        const intl none_high = IS_OPEN(cut, max_lanes(high, sample.q), min_lanes(high, sample.q));
        unknown = unknown | (none_low & none_high);
        slope[axis] = (select_lanes(none_high, sample.q, high) - select_lanes(none_low, sample.q, low)) /
                      (aside * select_lanes(none_low | none_high, (floatl)1.0f, (floatl)2.0f));
    }
    for (int i = 0; i < 3; i++)
        p[i] = MAP_ROW(D, i, sample.u, sample.v, sample.q);
    /* If the target sees the back, the determinant of the mapped point and of its derivatives along u and v is
     * negative. Each derivative is a column of the map plus the slope times the map's last column. */
    const floatl by_u = ORIENTATION(D, p, 3, 1), by_v = ORIENTATION(D, p, 0, 3);
    const floatl unsure = SLOPE_DEVIATIONS / (2.0f * aside) * (noise.a + sample.q * (noise.b + sample.q * noise.c));
    return !unknown & (ORIENTATION(D, p, 0, 1) + slope[0] * by_u + slope[1] * by_v + unsure * (fabs(by_u) + fabs(by_v)) < 0.0f);
}

kernel void color_samples(global const float *places, global const float *depth, global const float *nearness,
                          global const float *shown, global const channel *color, int width, int height, int pitch,
                          int perspective, float far, PixelMap map, Cut cut, Cut shown_cut, Noise noise, Lens lens,
                          global channel *sample_color, global uchar *seen)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    const intl x = x0 + lane_index;
    const size_t at = (size_t)y * width + x0;
    const floatl z = load_first(depth + at, width - x0, 0.0f);
    intl active = (z > NEAREST) & (z < far);
#if HAS_PLACES
    global const float *place = places + (size_t)y * pitch + x0;
    Point sample = {load_lanes(place), load_lanes(place + (size_t)height * pitch), 0.0f};
    active = active & (sample.u == sample.u);
    sample.u = select_lanes(active, sample.u, (floatl)0.0f);
    sample.v = select_lanes(active, sample.v, (floatl)0.0f);
#else
    Point sample = {to_floatl(x), y, 0.0f};
#endif
    sample.q = select_lanes(active, perspective ? 1.0f / z : -z, (floatl)1.0f);

    /* The sample's pixel: (u, v) in the pinhole's image, (at_u, at_v) in the lens's image */
    const floatl w = MAP_ROW(D, 2, sample.u, sample.v, sample.q), per_w = 1.0f / w;
    const floatl u = MAP_ROW(D, 0, sample.u, sample.v, sample.q) * per_w;
    const floatl v = MAP_ROW(D, 1, sample.u, sample.v, sample.q) * per_w;
    const floatl n = MAP_ROW(D, 3, sample.u, sample.v, sample.q) * per_w;
    active = active & (w > 0.0f) & IS_BEFORE(map.dst_perspective, n);
    floatl at_u = u, at_v = v;
    active = active & through_lens(lens, &at_u, &at_v);
    active = active & (at_u >= -0.5f) & (at_u <= map.dst_width - 0.5f) & (at_v >= -0.5f) & (at_v <= map.dst_height - 0.5f);
    at_u = select_lanes(active, at_u, (floatl)0.0f);
    at_v = select_lanes(active, at_v, (floatl)0.0f);

    /* The depths that the target shows at four pixels around the sample, and the sample's own depth in the target */
    const Taps taps = clamped_taps(map.dst_width, map.dst_height, at_u, at_v);
    const floatl own_z = DEPTH_OF(map.dst_perspective, n);
    floatl around[4], weights[4], total = 0.0f, farthest = -INFINITY;
    intl torn[4];
    tap_weights(taps.fx, taps.fy, weights);
    for (int i = 0; i < 4; i++) {
        around[i] = (floatl)(gather(shown, taps.at[i]));
        torn[i] = ARE_TORN(map.dst_perspective, shown_cut, min_lanes(around[i], own_z), max_lanes(around[i], own_z));
        weights[i] = select_lanes(torn[i], (floatl)0.0f, weights[i]);
        total += weights[i];
        farthest = max_lanes(around[i], farthest);
    }
    const floatl z_there = NEAREST_TAP(taps, around);
    const intl none = active & !(z_there == z_there), torn_there = NEAREST_TAP(taps, torn);
    /* Is the shown surface nearer? Not if it contains the sample, and one of its four pixels is as far away. */
    const floatl nearer_by = RELATIVE_TOLERANCE * fabs(own_z);
    const intl before = active & (own_z - z_there > nearer_by) & (torn_there | (own_z - farthest > nearer_by));
    intl is_seen = active;
    if (any_lane(before)) {
        const floatl there = map.dst_perspective ? 1.0f / z_there : -z_there;
        const floatl back = MAP_ROW(S, 2, u, v, there);
        const Point front = {MAP_ROW(S, 0, u, v, there) / back, MAP_ROW(S, 1, u, v, there) / back, MAP_ROW(S, 3, u, v, there) / back};
        const intl behind = !(back > 0.0f);
        is_seen = is_seen & !(before & behind) & !is_occluded(nearness, map, cut, noise, sample, front, before & !behind);
    }
    for (int wide = 1; wide <= 3 && any_lane(none); wide += 2)
        is_seen = is_seen & !(none & faces_away(nearness, map, cut, noise, sample, wide * SLOPE_STEP));

    const int pixels = map.dst_width * map.dst_height;
    const floatl per_total = 1.0f / total;
    Color c = {0.0f, 0.0f, 0.0f};
    for (int i = 0; i < 4; i++)
        add_color(&c, weights[i] * per_total, read_color(color, taps.at[i], pixels));
    const intl mixes = total > 1e-6f;
    if (any_lane(is_seen & !mixes))
        c = select_color(mixes, c, read_color(color, NEAREST_TAP(taps, taps.at), pixels));
    const Color black = {0.0f, 0.0f, 0.0f};
    c = select_color(is_seen, c, black);
    write_first(sample_color + CHANNELS * at, c, width - x0);
    store_first_bytes(is_seen & 1, seen + at, width - x0);
}
