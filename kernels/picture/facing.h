#ifndef PICTURE_FACING_H
#define PICTURE_FACING_H
/* What a thing has drawn into a picture, and its normals from the picture's depths: for what has no others. */
#include "lib/screen.h"

/* LANES pixels of a row */
typedef struct {
    intl x, y;
    intl drawn; /* which of them show the thing */
    floatl n;   /* their nearness */
    Vector p;   /* what they show, in the world */
} Drawn;

/* Nearness of pixels; EMPTY beside the picture and where there is nothing */
floatl picture_nearness(global const float *depth, Screen screen, intl x, intl y)
{
    const intl inside = (x >= 0) & (x < screen.width) & (y >= 0) & (y < screen.height);
    const intl at = pick(inside, y * screen.width + x, (intl)0);
    const floatl z = (floatl)(gather(depth, at));
    return pick(inside & (z == z), DEPTH_OF(screen.perspective, z), (floatl)EMPTY);
}

/* Along the surface, the way (dx, dy) from the point p of a pixel; a pixel alone is taken to be level. */
Vector tangent_along(global const float *depth, Screen screen, intl x, intl y, int dx, int dy, floatl n, Vector p)
{
    const floatl next = picture_nearness(depth, screen, x + dx, y + dy), last = picture_nearness(depth, screen, x - dx, y - dy);
    const intl forward = fabs(next - n) <= fabs(last - n);
    const floatl near = pick(forward, next, last), sign = pick(forward, (floatl)1.0f, (floatl)-1.0f);
    const Vector to = point_at(screen, to_floatl(x) + sign * dx, to_floatl(y) + sign * dy, pick(near > EMPTY, near, n));
    return scaled(minus(to, p), sign);
}

/* The unit normal of a pixel's surface, towards the viewer: along x and y, of the neighbours `neighbour_offset` pixels away the one
 * whose nearness differs less tells how it slopes. n, p: the pixel's nearness and point. */
Vector facing_at(global const float *depth, Screen screen, intl x, intl y, int neighbour_offset, floatl n, Vector p)
{
    const Vector across = tangent_along(depth, screen, x, y, neighbour_offset, 0, n, p);
    const Vector down = tangent_along(depth, screen, x, y, 0, neighbour_offset, n, p);
    const Vector normal = cross_product(across, down), ahead = view_direction(screen, p);
    const floatl unit = pick(DOT(normal, ahead) > 0.0f, (floatl)-1.0f, (floatl)1.0f) /
                        sqrt(max_lanes(DOT(normal, normal), (floatl)1e-37f));
    return scaled(normal, unit);
}

/* The pixels from `first` on: those that show something that they did not before, or, of a blank picture, anything. */
Drawn drawn_at(global const float *before, global const float *depth, Screen screen, int blank, int first, int row)
{
    const intl x = min(first + lane_index, (intl)(screen.width - 1)), y = (intl)row, at = y * screen.width + x;
    const floatl z = (floatl)(gather(depth, at)), z_before = (floatl)(gather(before, at));
    Drawn made = {x, y, (first + lane_index < screen.width) & (z == z) & (blank ? (intl)(z == z) : !(z == z_before))};
    made.n = pick(made.drawn, DEPTH_OF(screen.perspective, z), (floatl)(screen.perspective ? 1.0f : -1.0f));
    made.p = point_at(screen, to_floatl(x), to_floatl(y), made.n);
    return made;
}
#endif
