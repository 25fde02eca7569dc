#ifndef GAUSSIANS_HARMONICS_H
#define GAUSSIANS_HARMONICS_H
/* Colours by spherical harmonics of degree 0 to 3, with the signs and the order of 3D Gaussian Splatting (Kerbl et al.
 * 2023). */
#include "lib/color.h"
#include "lib/vectors.h"

/* The colours of LANES Gaussians, seen along the unit directions d. Coefficients lie in planes of `pitch` values: for
 * each harmonic red, green and blue. */
INLINED Color harmonic_colors(global const float *coefficients, int pitch, int degree, Vector d)
{
    const floatl x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z, none = 0.0f;
    Color sum = {0.5f, 0.5f, 0.5f};
#define COEFFICIENT(plane) load_lanes(coefficients + (size_t)(plane) * pitch)
#define ADD_HARMONIC(k, basis)                                                                                 \
    {                                                                                                          \
        const Color c = {COEFFICIENT(3 * k), COEFFICIENT(3 * k + 1), COEFFICIENT(3 * k + 2)};                  \
        add_color(&sum, basis, c);                                                                             \
    }
    ADD_HARMONIC(0, (floatl)0.28209479f)
    if (degree > 0) {
        ADD_HARMONIC(1, -0.48860251f * y)
        ADD_HARMONIC(2, 0.48860251f * z)
        ADD_HARMONIC(3, -0.48860251f * x)
    }
    if (degree > 1) {
        ADD_HARMONIC(4, 1.09254843f * x * y)
        ADD_HARMONIC(5, -1.09254843f * y * z)
        ADD_HARMONIC(6, 0.31539157f * (2.0f * zz - xx - yy))
        ADD_HARMONIC(7, -1.09254843f * x * z)
        ADD_HARMONIC(8, 0.54627422f * (xx - yy))
    }
    if (degree > 2) {
        ADD_HARMONIC(9, -0.59004359f * y * (3.0f * xx - yy))
        ADD_HARMONIC(10, 2.89061144f * x * y * z)
        ADD_HARMONIC(11, -0.45704580f * y * (4.0f * zz - xx - yy))
        ADD_HARMONIC(12, 0.37317633f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy))
        ADD_HARMONIC(13, -0.45704580f * x * (4.0f * zz - xx - yy))
        ADD_HARMONIC(14, 1.44530572f * z * (xx - yy))
        ADD_HARMONIC(15, -0.59004359f * x * (xx - 3.0f * yy))
    }
    const Color shown = {max_lanes(sum.r, none), max_lanes(sum.g, none), max_lanes(sum.b, none)};
    return shown;
}
#endif
