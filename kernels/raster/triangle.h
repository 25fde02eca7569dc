/* Edges of triangles in homogeneous pixel space (Olano & Greer 1997): no clipping, since an edge function is positive
 * on the visible side only, even where a corner lies behind the camera.
 *
 * What is covered is decided in whole numbers, on corners that are moved to the nearest 1/256 of a pixel, or in
 * floating point for edges with a corner behind the camera or far off. Either way two triangles that share an edge
 * have exactly opposite functions, and the top-left rule gives the pixels on it to one of them.
 */
#include "lib/screen.h"

#define SUBPIXELS 256
#define FARTHEST_CORNER 16384.0f /* pixels from the region: beyond, whole numbers of 32 bits do not suffice */

/* a x + b y + c, positive inside */
typedef struct {
    float a, b, c;
} Edge;

/* a x + b y + c, not negative on the pixels inside */
typedef struct {
    int a, b, c;
} ExactEdge;

/* The function of the edge from p to q: exactly the opposite of that from q to p */
Edge edge_of(float4 p, float4 q)
{
#pragma OPENCL FP_CONTRACT OFF /* which rounds one of two products only */
    const Edge e = {p.y * q.z - p.z * q.y, p.z * q.x - p.x * q.z, p.x * q.y - p.y * q.x};
    return e;
}

/* Which of two triangles has the pixels on their edge */
#define IS_TOP_LEFT(e) ((e).a > 0 || ((e).a == 0 && (e).b > 0))

/* The same for corners in subpixels: exact, with the top-left rule. */
ExactEdge exact_edge(int2 p, int2 q)
{
    ExactEdge e;
    e.a = p.y - q.y;
    e.b = q.x - p.x;
    const long c = -((long)e.a * p.x + (long)e.b * p.y) - !IS_TOP_LEFT(e);
    e.c = (int)clamp(c >> 8, -(1L << 29), 1L << 29); /* a x + b y counts subpixels times pixels */
    return e;
}

/* The corner's position relative to pixel (x, y) */
float4 relative_to(float4 corner, int x, int y)
{
    corner.x -= x * corner.z;
    corner.y -= y * corner.z;
    return corner;
}
