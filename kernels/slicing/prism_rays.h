#ifndef SLICING_PRISM_RAYS_H
#define SLICING_PRISM_RAYS_H
/* Rays in a prism: the heights of their points, and the weights of the prism's corners there.
 *
 * Each corner of the base has a vector to the corner above it. The slice at height h is the base triangle with each
 * corner moved by h times its vector. A point of the slice is a weighted mean of the moved corners. In the prism's
 * frame, (a, b, c) is the first corner's vector; (a1, b1, c1) and (a2, b2, c2) are the second and third corner's vector
 * minus the first's. The weights `second` and `third` of the second and third corner obey
 *
 *   second (1 + h a1) + third h a2 = x - h a       x, y, z: the point in the frame
 *   second h b1 + third (1 + h b2) = y - h b
 *   h (c + second c1 + third c2) = z
 *
 * The first two equations give the weights for a height h. Put into the third equation, the weights leave a cubic in h,
 * whose coefficients are linear in x, y and z, and so linear in depth along a ray. So the depth at which a ray reaches
 * a height has a closed form. The height at a depth is found by Newton steps from h = z / (c + x c1 + y c2), which is
 * exact if the corners' vectors are parallel.
 */
#include "slicing/prisms.h"

#define NEWTON_STEPS 2 /* reduce an error of a few hundredths to the rounding error */

typedef struct {
    Linear second, third, rise;
} PrismRays;

/* A height, and the weights of the second and third corner */
typedef struct {
    floatl h, second, third;
} Place;

INLINED Linear along_ray(const Prism *t, Quantity q, floatl x, floatl y)
{
    const floatl at = q.x * x + (q.y * y + q.one);
    Linear made;
    made.fixed = t->perspective ? (floatl)q.n : at;
    made.sloped = t->perspective ? at : (floatl)(-q.n);
    return made;
}

/* The corners' weights for the points at height h and depth z */
INLINED Place place_at(const Bend *bend, const PrismRays *rays, floatl z, floatl h)
{
    const floatl x = AT(rays->second, z), y = AT(rays->third, z);
    const floatl per_area = 1.0f / (1.0f + h * (bend->area_1 + h * bend->area_2));
    const floatl second = x + h * (x * bend->to_third.third - y * bend->to_third.second - bend->first.second +
                                   h * bend->second_2);
    const floatl third = y + h * (y * bend->to_second.second - x * bend->to_second.third - bend->first.third +
                                  h * bend->third_2);
    const Place place = {h, second * per_area, third * per_area};
    return place;
}

INLINED floatl depth_at_height(const Bend *bend, const PrismRays *rays, floatl h)
{
    const floatl by_x = h * (bend->to_second.rise + h * bend->by_second),
                 by_y = h * (bend->to_third.rise + h * bend->by_third);
    const floatl area = 1.0f + h * (bend->area_1 + h * bend->area_2);
    const floatl alone = h * (bend->first.rise + h * (bend->square + h * bend->cube));
    return (area * rays->rise.fixed - by_x * rays->second.fixed - by_y * rays->third.fixed - alone) /
           (by_x * rays->second.sloped + by_y * rays->third.sloped - area * rays->rise.sloped);
}

INLINED floatl height_at_depth(const Bend *bend, const PrismRays *rays, floatl z)
{
    const floatl x = AT(rays->second, z), y = AT(rays->third, z), rise = AT(rays->rise, z);
    const floatl bracket = bend->first.rise + x * bend->to_second.rise + y * bend->to_third.rise;
    const floatl one = bracket - rise * bend->area_1;
    const floatl two = bend->square + x * bend->by_second + y * bend->by_third - rise * bend->area_2;
    floatl h = clamp_lanes(rise / bracket, (floatl)-0.5f, (floatl)1.5f);
    for (int i = 0; i < NEWTON_STEPS; i++) {
        const floatl off = h * (one + h * (two + h * bend->cube)) - rise;
        const floatl slope = one + h * (2.0f * two + h * (3.0f * bend->cube));
        h = clamp_lanes(h - off / slope, (floatl)-0.5f, (floatl)1.5f);
    }
    return h;
}

INLINED Place place_at_depth(const Bend *bend, const PrismRays *rays, floatl z)
{
    return place_at(bend, rays, z, height_at_depth(bend, rays, z));
}
#endif
