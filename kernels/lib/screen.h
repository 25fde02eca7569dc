#ifndef LIB_SCREEN_H
#define LIB_SCREEN_H
/* The target of a rendering: its camera's pixel space (lib/pixelspace.h) over the world. */
#include "lib/lanes.h"
#include "lib/pixelspace.h"

#ifndef BIN
#define BIN 32 /* pixels, the side of a bin of the rasteriser */
#endif

typedef struct {
    float from_world[16]; /* (U, V, W, Q) of the world point (X, Y, Z, 1), row by row */
    float to_world[16];   /* the inverse */
    int width, height;
    int perspective;
    float nearest; /* the near plane: nearness beyond it is not drawn */
} Screen;

/* How far the target's picture lies at a pixel already: nearness, EMPTY where nothing is drawn. */
float drawn_nearness(Screen screen, float depth)
{
    return isnan(depth) ? EMPTY : (screen.perspective ? 1.0f / depth : -depth);
}

/* Unit vector in the world */
typedef struct {
    floatl x, y, z;
} Direction;

/* In which the picture sees the point (x, y, z) */
Direction towards(Screen screen, floatl x, floatl y, floatl z)
{
    const float *m = screen.to_world;
    Direction d = {-m[3], -m[7], -m[11]}; /* of an orthographic picture */
    if (screen.perspective) {
        d.x = x - m[3] / m[15];
        d.y = y - m[7] / m[15];
        d.z = z - m[11] / m[15];
    }
    const floatl unit = 1.0f / sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
    d.x *= unit;
    d.y *= unit;
    d.z *= unit;
    return d;
}
#endif
