#ifndef GAUSSIANS_HARMONICS_H
#define GAUSSIANS_HARMONICS_H
/* Colours by spherical harmonics of degree 0 to 3, with the signs and the order of 3D Gaussian Splatting (Kerbl et al.
 * 2023). */
#include "lib/color.h"
#include "lib/vectors.h"

/* Adds a harmonic's part of the colour. Coefficients lie in planes of `pitch` values: for each harmonic red, green and
 * blue. */
INLINED void add_harmonic(Color *sum, floatl basis, int harmonic, global const float *coefficients, int pitch)
{
    global const float *plane = coefficients + (size_t)3 * harmonic * pitch;
    const Color c = {load_lanes(plane), load_lanes(plane + pitch), load_lanes(plane + (size_t)2 * pitch)};
    add_color(sum, basis, c);
}

/* The colours of LANES Gaussians, seen along the unit directions d */
INLINED Color harmonic_colors(global const float *coefficients, int pitch, int degree, Vector d)
{
    const floatl x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
    Color sum = {0.5f, 0.5f, 0.5f};
#define ADD(harmonic, basis) add_harmonic(&sum, basis, harmonic, coefficients, pitch);
    ADD(0, (floatl)0.28209479f)
    if (degree > 0) {
        ADD(1, -0.48860251f * y)
        ADD(2, 0.48860251f * z)
        ADD(3, -0.48860251f * x)
    }
    if (degree > 1) {
        ADD(4, 1.09254843f * x * y)
        ADD(5, -1.09254843f * y * z)
        ADD(6, 0.31539157f * (2.0f * zz - xx - yy))
        ADD(7, -1.09254843f * x * z)
        ADD(8, 0.54627422f * (xx - yy))
    }
    if (degree > 2) {
        ADD(9, -0.59004359f * y * (3.0f * xx - yy))
        ADD(10, 2.89061144f * x * y * z)
        ADD(11, -0.45704580f * y * (4.0f * zz - xx - yy))
        ADD(12, 0.37317633f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy))
        ADD(13, -0.45704580f * x * (4.0f * zz - xx - yy))
        ADD(14, 1.44530572f * z * (xx - yy))
        ADD(15, -0.59004359f * x * (xx - 3.0f * yy))
    }
#undef ADD
    const Color shown = {max_lanes(sum.r, (floatl)0.0f), max_lanes(sum.g, (floatl)0.0f),
                         max_lanes(sum.b, (floatl)0.0f)};
    return shown;
}
#endif
