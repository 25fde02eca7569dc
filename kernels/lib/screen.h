/* The target of a rendering: its camera's pixel space (lib/pixelspace.h) over the world. */
#include "lib/pixelspace.h"

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
