#ifndef LIB_SCREEN_H
#define LIB_SCREEN_H
/* The screen on which a scene is drawn, with the maps between the world and the camera's pixel space
 * (lib/pixelspace.h). */
#include "lib/lanes.h"
#include "lib/pixelspace.h"
#include "lib/vectors.h"

#ifndef BIN
#define BIN 32 /* side of the rasteriser's bins in pixels */
#endif

typedef struct {
    float from_world[16]; /* matrix from the world point (X, Y, Z, 1) to (U, V, W, Q), row by row */
    float to_world[16];   /* the inverse */
    int width, height;
    int perspective;
    float nearest; /* nearness of the near plane: nothing nearer is drawn */
} Screen;

/* The nearness at a pixel, from the depth that is already drawn there; EMPTY if there is none */
float drawn_nearness(Screen screen, float depth)
{
    return isnan(depth) ? EMPTY : DEPTH_OF(screen.perspective, depth);
}

/* The depth to draw. It is never 0, which means an empty pixel; DEPTH_OF may be 0 if an orthographic camera stands in
 * the scene. */
#define DRAWN_DEPTH(screen, nearness)                                                                          \
    fmin(fmax(DEPTH_OF((screen).perspective, nearness), NEAREST_DEPTH), FARTHEST_DEPTH)

/* The point that pixel (x, y) shows at nearness n, in the coordinates that `to_world` yields */
INLINED Vector point_at(Screen screen, floatl x, floatl y, floatl n)
{
    const float *m = screen.to_world;
    const floatl inverse = 1.0f / MAP_ROW(m, 3, x, y, n);
    const Vector p = {MAP_ROW(m, 0, x, y, n) * inverse, MAP_ROW(m, 1, x, y, n) * inverse,
                      MAP_ROW(m, 2, x, y, n) * inverse};
    return p;
}

/* The nearness of a point in the world; negative behind a perspective camera */
INLINED floatl nearness_of(Screen screen, Vector p)
{
    const float *m = screen.from_world;
    return POINT_ROW(m, 3, p) / POINT_ROW(m, 2, p);
}

/* The unit viewing direction at a point */
INLINED Vector view_direction(Screen screen, Vector p)
{
    const float *m = screen.to_world;
    const Vector centre = {m[3] / m[15], m[7] / m[15], m[11] / m[15]}, along = {-m[3], -m[7], -m[11]};
    return normalized(screen.perspective ? minus(p, centre) : along);
}

/* The unit direction of a perspective picture's ray through pixel (x, y); also accurate for points near the eye */
INLINED Vector ray_direction(Screen screen, floatl x, floatl y)
{
    const float *m = screen.to_world;
    const Vector d = {PIXEL_ROW(m, 0, x, y), PIXEL_ROW(m, 1, x, y), PIXEL_ROW(m, 2, x, y)};
    return normalized(d);
}
#endif
