#ifndef LIB_LENS_H
#define LIB_LENS_H
/* Lens distortion, from a pinhole's pixels to the lens's, with the models of `pyibr.Lens` (pyibr/core/lens.py). */
#include "lib/lanes.h"

#ifndef LENS
/* 0: none; 1: Brown-Conrady, also rational; 2: RealSense's variant; 3: Kannala-Brandt's fisheye; 4: OpenCV's model
 * with a thin prism and a tilted sensor */
#define LENS 0
#endif

typedef struct {
    float fx, skew, cx, fy, cy; /* entries of K */
    float k[14];                /* coefficients in the model's order, padded with 0 */
    float tilt[9];              /* homography from an upright sensor to a tilted one, by rows */
    float reach;                /* greatest undistorted distance from the axis, at depth 1, in the field of view */
} Lens;

/* Maps the pinhole's pixels to the lens's pixels, in place. Returns the mask of lanes in the field of view; the other
 * lanes get arbitrary pixels. */
INLINED intl through_lens(Lens lens, floatl *u, floatl *v)
{
#if LENS == 0
    return (intl)-1;
#else
    const floatl y = (*v - lens.cy) / lens.fy, x = (*u - lens.cx - lens.skew * y) / lens.fx;
    const floatl square = x * x + y * y;
    const intl seen = square < lens.reach * lens.reach;
#if LENS == 3
    const floatl radius = sqrt(square), angle = atan(radius), s = angle * angle;
    const floatl series = 1.0f + s * (lens.k[0] + s * (lens.k[1] + s * (lens.k[2] + s * lens.k[3])));
    const floatl factor = select_lanes(radius > 1e-6f, angle * series / radius, (floatl)1.0f);
    const floatl a = x * factor, b = y * factor;
#else
    const floatl top = 1.0f + square * (lens.k[0] + square * (lens.k[1] + square * lens.k[4]));
    const floatl bottom = 1.0f + square * (lens.k[5] + square * (lens.k[6] + square * lens.k[7]));
    const floatl factor = top / bottom, p1 = lens.k[2], p2 = lens.k[3];
    floatl a = x * factor, b = y * factor;
#if LENS == 1 || LENS == 4
    const floatl c = x, d = y;
#else
    const floatl c = a, d = b;
#endif
    a += 2.0f * p1 * c * d + p2 * (square + 2.0f * c * c);
    b += 2.0f * p2 * c * d + p1 * (square + 2.0f * d * d);
#endif
#if LENS == 4
    a += square * (lens.k[8] + square * lens.k[9]);
    b += square * (lens.k[10] + square * lens.k[11]);
    const floatl w = lens.tilt[6] * a + lens.tilt[7] * b + lens.tilt[8];
    const floatl upright = a;
    a = (lens.tilt[0] * upright + lens.tilt[1] * b + lens.tilt[2]) / w;
    b = (lens.tilt[3] * upright + lens.tilt[4] * b + lens.tilt[5]) / w;
#endif
    *u = lens.fx * a + lens.skew * b + lens.cx;
    *v = lens.fy * b + lens.cy;
    return seen;
#endif
}
#endif
