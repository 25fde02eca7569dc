#ifndef PICTURE_FACING_H
#define PICTURE_FACING_H
/* Normals from a picture's depths, for surfaces without other normals. */
#include "lib/screen.h"

/* The part of a picture that shows one thing. Slopes are computed from pixels of this part alone. */
typedef struct {
    global const float *depth;
    global const float *entered; /* depths in the G-buffer (lib/gbuffer.h), or 0 if the whole picture shows one thing */
    global const int *things;    /* the G-buffer's number of the thing at each pixel */
    int thing;
} Shown;

/* Nearness of LANES pixels of a row, starting at x; EMPTY outside of the picture and in pixels of other things */
INLINED floatl picture_nearness(Shown shown, Screen screen, int x, int y)
{
    if (y < 0 || y >= screen.height || x + LANES <= 0 || x >= screen.width)
        return EMPTY;
    floatl z = NAN;
    intl of_thing = (intl)-1;
    const size_t start = (size_t)y * screen.width;
    global const float *row = shown.depth + start;
    if (x >= 0 && x + LANES <= screen.width) {
        z = load_lanes(row + x);
        if (shown.entered)
            of_thing = (load_lanes(shown.entered + start + x) == z) &
                       (load_lanes(shown.things + start + x) == shown.thing);
    } else {
        for (int lane = max(-x, 0); lane < min(LANES, screen.width - x); lane++) {
            set_float_lane(z, lane, row[x + lane]);
            const size_t at = start + x + lane;
            if (shown.entered)
                set_int_lane(of_thing, lane,
                             shown.entered[at] == row[x + lane] && shown.things[at] == shown.thing ? -1 : 0);
        }
    }
    return select_lanes(of_thing & (z == z), DEPTH_OF(screen.perspective, z), (floatl)EMPTY);
}

/* A tangent of the surface at a pixel's point p, along (dx, dy) in the picture. If both neighbours in this direction
 * are missing, nearness is assumed to stay the same. */
INLINED Vector tangent_along(Shown shown, Screen screen, int x, int y, int dx, int dy, floatl n, Vector p)
{
    const floatl next = picture_nearness(shown, screen, x + dx, y + dy),
                 last = picture_nearness(shown, screen, x - dx, y - dy);
    const intl forward = fabs(next - n) <= fabs(last - n);
    const floatl near = select_lanes(forward, next, last), sign = select_lanes(forward, (floatl)1.0f, (floatl)-1.0f);
    const floatl there_x = to_floatl(x + lane_index) + sign * dx, there_y = y + sign * dy;
    return scaled(minus(point_at(screen, there_x, there_y, select_lanes(near > EMPTY, near, n)), p), sign);
}

/* The unit normals of LANES pixels of a row, from x on, turned towards the viewer. Along each axis, the slope leads to
 * one of the two neighbours that are `neighbour_offset` pixels away: to the one whose nearness differs less. n, p: the
 * pixels' nearness and points. */
INLINED Vector facing_at(Shown shown, Screen screen, int x, int y, int neighbour_offset, floatl n, Vector p)
{
    const Vector across = tangent_along(shown, screen, x, y, neighbour_offset, 0, n, p);
    const Vector down = tangent_along(shown, screen, x, y, 0, neighbour_offset, n, p);
    const Vector normal = cross_product(across, down), ahead = view_direction(screen, p);
    const floatl unit = select_lanes(DOT(normal, ahead) > 0.0f, (floatl)-1.0f, (floatl)1.0f) /
                        sqrt(max_lanes(DOT(normal, normal), (floatl)1e-37f));
    return scaled(normal, unit);
}
#endif
