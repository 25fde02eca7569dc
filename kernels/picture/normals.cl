/* Computes normals from a depth image: at each sample, a plane is fitted to the surrounding samples by least squares.
 *
 * On a plane, nearness is affine, so the fit is linear. It uses the samples up to `radius` away along x and y that lie
 * on one surface with the middle sample (lib/surface.h); next to an edge, these all lie on one side of it. An isolated
 * sample's normal points to the camera. nearness: (height, pitch), picture/nearness.cl. normals: (height, width, 3) of
 * unit length, in the camera's frame, pointing towards the camera; arbitrary for invalid samples. fx, skew, fy, cx, cy:
 * entries of the camera's K. Work-item: LANES samples of a row. Cost: O(samples * radius^2), radius <= RADIUS_MAX.
 * Determinism: samples are independent.
 */
#include "lib/surface.h"
#include "lib/vectors.h"

#define RADIUS_MAX 8
#define REGULARIZATION 1e-4f /* added fraction of the spread: across samples on a single line, the plane is level */

kernel void fit_normals(global const float *nearness, global float *normals, int width, int height, int pitch,
                        int perspective, Cut cut, int radius, float fx, float skew, float fy, float cx, float cy)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= width || row >= height)
        return;
    const intl x = min(first + lane_index, (intl)(width - 1));
    const floatl middle = (floatl)(gather(nearness, row * pitch + x));
    const floatl scale = perspective ? 1.0f / middle
                                     : (floatl)1.0f; /* squares of nearness may exceed float32 */
    floatl count = 0.0f, sx = 0.0f, sy = 0.0f, sn = 0.0f, sxx = 0.0f, sxy = 0.0f, syy = 0.0f, sxn = 0.0f, syn = 0.0f;
    for (int dy = max(-radius, -row); dy <= min(radius, height - 1 - row); dy++)
        for (int dx = -radius; dx <= radius; dx++) {
            const intl at = x + dx, inside = (at >= 0) & (at < width);
            const floatl n = (floatl)(gather(nearness, (row + dy) * pitch + select_lanes(inside, at, x)));
            const intl one_surface = inside & !IS_OPEN(cut, max_lanes(n, middle), min_lanes(n, middle));
            const floatl weight = select_lanes(one_surface, (floatl)1.0f, (floatl)0.0f);
            const floatl step = select_lanes(one_surface, (n - middle) * scale, (floatl)0.0f);
            count += weight;
            sx += weight * dx;
            sy += weight * dy;
            sxx += weight * (dx * dx);
            sxy += weight * (dx * dy);
            syy += weight * (dy * dy);
            sn += step;
            sxn += step * dx;
            syn += step * dy;
        }
    const floatl each = 1.0f / max_lanes(count, (floatl)1.0f);
    const floatl spread_x = sxx - sx * sx * each, spread_y = syy - sy * sy * each,
                 little = REGULARIZATION * (spread_x + spread_y);
    const floatl xx = spread_x + little, yy = spread_y + little, xy = sxy - sx * sy * each;
    const floatl xn = sxn - sx * sn * each, yn = syn - sy * sn * each, inverse = 1.0f / (xx * yy - xy * xy);
    const floatl gx = (yy * xn - xy * yn) * inverse, gy = (xx * yn - xy * xn) * inverse; /* NaN if isolated */
    const floatl off_x = perspective ? cx - to_floatl(x) : (floatl)0.0f, off_y = perspective ? cy - row : 0.0f;
    /* A point p = z ray of the plane N.p = 1 has nearness 1/z = N.ray, which changes by N.x / fx per column. N points
     * away from the camera. */
    const Vector plane = {gx * fx, gx * skew + gy * fy, 1.0f + gx * off_x + gy * off_y};
    const floatl largest = max_lanes(max_lanes(fabs(plane.x), fabs(plane.y)), fabs(plane.z));
    const Vector away = normalized(scaled(plane, 1.0f / max_lanes(largest, (floatl)1e-30f)));
    const intl valid = isfinite_lanes(away.x + away.y + away.z) & (middle > NO_SURFACE);
    for (int lane = 0; lane < min(LANES, width - first); lane++) {
        const float3 normal = -(float3)(float_lane(away.x, lane), float_lane(away.y, lane), float_lane(away.z, lane));
        vstore3(int_lane(valid, lane) ? normal : (float3)(0.0f, 0.0f, -1.0f), (size_t)row * width + first + lane,
                normals);
    }
}
