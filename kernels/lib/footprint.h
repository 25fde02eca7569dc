#ifndef LIB_FOOTPRINT_H
#define LIB_FOOTPRINT_H
/* Footprints of pixels on maps. On an oblique surface, a footprint is longer than wide. With ANISOTROPIC, the map is
 * read at 1 to `anisotropy` places (probes) along the longer side, from the mipmap level whose texels are as large as
 * the shorter side (McCormack et al. 1999, but with the footprint's exact ellipse). Otherwise, there is one probe.
 *
 * Cost: the number of probes is the rounded ratio of the sides, so a surface that faces the camera needs only one
 * probe.
 */
#include "lib/normals.h"
#include "lib/screen.h"
#include "lib/texture.h"

#ifndef ANISOTROPIC
#define ANISOTROPIC 0 /* 1: the kernel has `int anisotropy`, and reads several probes */
#endif

#if ANISOTROPIC
#define ANISOTROPY_PARAMETER , int anisotropy
#define ANISOTROPY , anisotropy
#else
#define ANISOTROPY
#define ANISOTROPY_PARAMETER
#endif

typedef struct {
    floatl texels_2; /* square of the length that a probe covers, in texels of the first level */
    floatl count;    /* number of probes */
    floatl u, v;     /* vector along the longer side, and as long; probes are spaced evenly along it */
} Footprint;

INLINED Footprint isotropic_footprint(floatl texels_2)
{
    const Footprint f = {texels_2, (floatl)1.0f, (floatl)0.0f, (floatl)0.0f};
    return f;
}

#if ANISOTROPIC
#define MORE_PROBES 0.75f /* the number of probes is the ratio of the sides plus this, rounded down */

/* Changes of u and v per pixel along x and along y */
typedef struct {
    floatl u_x, v_x, u_y, v_y;
    int anisotropy; /* greatest number of probes */
} UvSteps;

/* The changes of u and v per pixel, on a plane that pixels show at nearness n. ahead: unit viewing direction;
 * normal: the plane's normal, of any length; along_u, along_v: gradients of u and v in the world. A footprint longer
 * than `anisotropy` times its width is shortened, as if the plane were less oblique. The width stays, so that steep
 * surfaces at outlines are not blurred. */
INLINED UvSteps uv_steps(Screen screen, floatl n, Vector ahead, Vector normal, Vector along_u, Vector along_v,
                         int anisotropy)
{
    const float *m = screen.to_world;
    const float least = 1.0f / anisotropy;
    const floatl depth = screen.perspective ? 1.0f / (m[15] * n) : (floatl)(1.0f / m[14]);
    const floatl steepest = -least * sqrt(DOT(normal, normal)), facing = min_lanes(DOT(normal, ahead), steepest);
    const floatl per_facing = 1.0f / min_lanes(facing, (floatl)-1e-30f);
    floatl steps[2][2];
    UNROLLED
    for (int axis = 0; axis < 2; axis++) {
        const Vector level = {m[axis] * depth, m[4 + axis] * depth, m[8 + axis] * depth}; /* one pixel, in the world */
        const floatl slide = DOT(normal, level) * per_facing;
        steps[axis][0] = DOT(along_u, level) - slide * DOT(along_u, ahead);
        steps[axis][1] = DOT(along_v, level) - slide * DOT(along_v, ahead);
    }
    const UvSteps made = {steps[0][0], steps[0][1], steps[1][0], steps[1][1], anisotropy};
    return made;
}

/* The footprint of a round pixel: an ellipse on the map. Its axes are as long as the singular values of the matrix of
 * steps, in texels. */
INLINED Footprint footprint_of(UvSteps s, int width, int height, intl wanted)
{
    const floatl a = s.u_x * width, b = s.u_y * width, c = s.v_x * height, d = s.v_y * height;
    const floatl uu = a * a + b * b, uv = a * c + b * d, vv = c * c + d * d, half_ = 0.5f * (uu - vv),
                 area = a * d - b * c;
    const floatl given = 0.5f * (uu + vv) + sqrt(half_ * half_ + uv * uv);
    const intl minified = wanted & isfinite_lanes(given) & (given > 1.0f); /* mask; other lanes have one probe */
    const floatl long_2 = select_lanes(minified, given, (floatl)1.0f),
                 short_2 = max_lanes(area * area / long_2, (floatl)1.0f);
    Footprint f = isotropic_footprint(long_2);
    f.count = select_lanes(minified, truncated(sqrt(long_2 / short_2) + MORE_PROBES), (floatl)1.0f);
    f.count = clamp_lanes(f.count, (floatl)1.0f, (floatl)s.anisotropy);
    if (!any_lane(f.count > 1.0f))
        return f;
    f.texels_2 = max_lanes(long_2 / (f.count * f.count), short_2);
    /* The longer axis is an eigenvector of the matrix (uu, uv; uv, vv). It is computed from the matrix row with smaller
     * rounding errors. */
    const floatl x = select_lanes(half_ >= 0.0f, long_2 - vv, uv), y = select_lanes(half_ >= 0.0f, uv, long_2 - uu);
    const floatl unit = select_lanes(f.count > 1.0f, sqrt(long_2 / max_lanes(x * x + y * y, (floatl)1e-30f)),
                                     (floatl)0.0f);
    f.u = x * unit * (1.0f / width);
    f.v = y * unit * (1.0f / height);
    return f;
}
#endif

/* The probes of a footprint: a loop over their numbers i; the mask of lanes that have probe i; the probe's position
 * along the footprint, -0.5 to 0.5; and its weight */
#if ANISOTROPIC
#define EACH_PROBE(f, i) for (int i = 0; any_lane((f).count > (float)i); i++)
#define HAS_PROBE(f, i) ((f).count > (float)(i))
#define PROBE_OFFSET(f, i) select_lanes(HAS_PROBE(f, i), ((i) + 0.5f) / (f).count - 0.5f, (floatl)0.0f)
#define PROBE_WEIGHT(f, i) select_lanes(HAS_PROBE(f, i), 1.0f / (f).count, (floatl)0.0f)
#endif

/* The footprint on the next coarser level: half as many probes, each of which covers twice the length */
INLINED Footprint on_coarser(Footprint f)
{
    f.texels_2 *= 4.0f;
    f.count = truncated(0.5f * f.count + 0.5f);
    return f;
}

/* Adds to `sum` the mean of a texture's level over the footprint around (u, v), times a weight. */
OUTLINED void add_footprint(global const uint *texels, floatl u, floatl v, Footprint f, intl level, int width,
                           int height, floatl weight, Color *sum)
{
    intl w = width, h = height;
    const intl start = start_of_level(level, &w, &h);
#if ANISOTROPIC
    EACH_PROBE(f, i)
    {
        const floatl along = PROBE_OFFSET(f, i);
        add_texels(texels, u + f.u * along, v + f.v * along, start, w, h, weight * PROBE_WEIGHT(f, i), sum);
    }
#else
    add_texels(texels, u, v, start, w, h, weight, sum);
#endif
}

#if ANISOTROPIC
/* The mean of a normal map over a pixel around (u, v) */
INLINED Vector mean_normal(global const float *map, int width, int height, floatl u, floatl v, UvSteps steps,
                           intl wanted)
{
    const Footprint f = footprint_of(steps, width, height, wanted);
    const intl level = level_of_texels(f.texels_2, 32 - clz(max(width, height)));
    Vector mean = {0.0f, 0.0f, 0.0f};
    EACH_PROBE(f, i)
    {
        const floatl along = PROBE_OFFSET(f, i), weight = PROBE_WEIGHT(f, i);
        const Vector one = normal_in(map, width, height, level, u + f.u * along, v + f.v * along);
        mean.x += weight * one.x;
        mean.y += weight * one.y;
        mean.z += weight * one.z;
    }
    return mean;
}
#endif
#endif
