#ifndef DEPTHMESH_TREE_H
#define DEPTHMESH_TREE_H
/* The restricted quadtree over a depth image's samples (Pajarola 1998; Pajarola, Sainz & Meng 2003, section 3.2).
 *
 * Vertices are the points (x, y) of a square grid. The number of cells along its side is a power of two, and the
 * image covers the upper left part of the grid. The rest is padding, whose vertices are moved to the image's last
 * column or row. So triangles in the padding have no area, and triangles that cross the border are squeezed into the
 * image. As columns and rows keep their order, no triangle turns over, and the triangles cover the whole image.
 *
 * Each vertex except the four corners bisects an edge of the next coarser triangulation. The step s of a vertex is the
 * largest power of two that divides x and y. A vertex is
 *   a centre   (x/s and y/s are odd): it bisects the diagonal of the block of side 2s around it;
 *   a midpoint (either x/s or y/s is odd): it bisects an edge of length 2s along x or y.
 * The diagonal of a block runs from its upper left to its lower right corner (`main`) if the sum of the block's column
 * and row is even, so the diagonals of four blocks meet in the centre of the larger block that they form. The two
 * triangles that share the bisected edge are the sides of the vertex: side A above it (left, if the edge is along y),
 * side B below (or right). A side is split into two triangles, each of which is a side of another vertex, a child of
 * this vertex. The children of a midpoint are the centres at (+-s/2, +-s/2), the children of a centre are the midpoints
 * at (+-s, 0) and (0, +-s). In a triangulation without cracks, the parents of each active (used) vertex are active.
 *
 * A sample stands for its whole pixel, so vertices at outermost samples are drawn half a pixel farther out, with the
 * nearness that samples.cl computes there. The states of vertices refer to the samples, their errors to drawn vertices.
 *
 * The point at pixel (x, y) and depth z is stored as (a, b, c): (x z, y z, z) in a perspective view, (x, y, -z) in an
 * orthographic view. A 4x4 matrix maps (a, b, c, 1) to another camera's pixel space.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"
#include "lib/surface.h"
#include "lib/vectors.h"

/* The state of a triangle has the bit DRAWN if it contains drawn cells, and UNDRAWN if it contains undrawn cells; it is
 * 0 if there is no triangle. The byte of a vertex holds the state of side A in its lower two bits and of side B in the
 * next two. In the byte of a cell, A is the upper triangle and B the lower one. */
#define UNDRAWN 1
#define DRAWN 2
#define SIDE_BITS 2
#define STATE_A(byte) ((byte) & 3)
#define STATE_B(byte) ((byte) >> SIDE_BITS & 3)

typedef struct {
    float ray[6];    /* the sample (x, y) lies at (ray[0] x + ray[1] y + ray[2], ray[3] x + ray[4] y + ray[5], 1) z;
                        in an orthographic view, only the third coordinate is multiplied by z */
    float footprint; /* size of a sample in scene units, at depth 1 in a perspective view */
    float noise[3];  /* a, b, c: standard deviation a z z + b z + c of the depths at depth z; 0 if not known */
    int perspective;
    int width, height; /* samples */
    int pitch;         /* samples from one row to the next */
    int side;          /* cells along the tree's side */
    int row;           /* vertices from one row of the tree to the next */
} Layout;

#define IS_SAMPLE(nearness) ((nearness) > 0.5f * NO_SURFACE)

/* The noise of depths: a z z + b z + c at depth z. `noise_of_nearness`: the noise at nearness n, as nearness */
#define NOISE_AT(of, z) (((of)[0] * (z) + (of)[1]) * (z) + (of)[2])
INLINED floatl noise_of_nearness(const Layout *layout, const float *of, floatl n)
{
    if (!layout->perspective)
        return NOISE_AT(of, -n);
    return of[0] + (of[1] + of[2] * n) * n; /* the difference of depth, times n^2 */
}

/* The sample (x, y) with depth z, in the frame of the view's camera */
Vector point_of(const Layout *layout, floatl x, floatl y, floatl z)
{
    const float *r = layout->ray;
    const floatl scale = layout->perspective ? z : (floatl)1.0f;
    const Vector p = {(r[0] * x + r[1] * y + r[2]) * scale, (r[3] * x + r[4] * y + r[5]) * scale, z};
    return p;
}

/* Offset from a sample to its drawn vertex along an axis with `count` samples, in samples; 0 except at the border */
INLINED floatl beyond_sample(intl x, int count)
{
    return select_lanes(x == 0, (floatl)-BORDER, select_lanes(x == count - 1, (floatl)BORDER, (floatl)0.0f));
}

/* Coordinate of the drawn vertex of sample x, moved by beyond_sample */
float place_of(int x, int count)
{
    return x + (x == 0 ? -BORDER : x == count - 1 ? BORDER : 0.0f);
}

/* Does the diagonal of the block with centre (x, y) and side 2s run to the lower right? */
#define IS_MAIN(x, y, s) (!(((x) ^ (y)) & (2 * (s))))

/* Step of a vertex: the largest power of two that divides x and y */
int step_of(int x, int y)
{
    return (x | y) & -(x | y);
}

#define IS_CENTER(x, y, s) (((x) & (y) & (s)) != 0)

/* Mask of the centres of step s whose blocks cross the last column or row, and so are squeezed into the image */
INLINED intl is_squeezed(const Layout *layout, intl x, intl y, int s)
{
    return (x + s >= layout->width) | (y + s >= layout->height);
}

/* Loads LANES numbers of a row from first + dx on, dx in {-1, 0, 1}. Nothing is read in front of the row. */
#define NEXT_TO(load, row, first, dx) ((dx) < 0 && !(first) ? shifted_lanes(load(row)) : load((row) + (first) + (dx)))

/* Bytes of the cells that lie at the offset (dx, dy), each -1 or 0, from the vertices x of row y; 0 outside the
 * image */
intl cell_next_to(const Layout *layout, global const uchar *cells, intl x, int first, int y, int dx, int dy)
{
    if (y + dy < 0 || y + dy >= layout->height - 1)
        return (intl)0;
    const intl byte = NEXT_TO(load_bytes, cells + (size_t)(y + dy) * layout->pitch, first, dx);
    return select_lanes((x + dx >= 0) & (x + dx < layout->width - 1), byte, (intl)0);
}

/* Rounding error of a sum of depths, as a fraction of the sum. Points on a line may seem to lie beside the line by this
 * error, so smaller distances count as 0. */
#define ROUNDING 0x1p-22f

/* Marks of vertices. LISTED: corner of a triangle; ACTIVE: also, triangles may have their right angle at the vertex */
#define LISTED 2
#define ACTIVE 3
#define IS_ACTIVE(mark) ((mark) == ACTIVE)

/* Marks the four corners of the tree. At two of these corners lie the right angles of the coarsest triangles. */
void mark_corners(const Layout *layout, global uchar *active, int y)
{
    if (y > 0 && y < layout->side)
        return;
    global uchar *row = active + (size_t)y * layout->row;
    row[y] = LISTED;
    row[layout->side - y] = ACTIVE;
}
#endif
