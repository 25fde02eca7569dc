#ifndef DEPTHMESH_TREE_H
#define DEPTHMESH_TREE_H
/* The restricted quadtree over a depth image's samples (Pajarola 1998; Pajarola, Sainz & Meng 2003, section 3.2).
 *
 * Vertices are the points (x, y) of a square grid with a power of two of cells along its side, of which the image
 * covers the upper left part. The rest is padding: its vertices lie on the image's last column and row, so that
 * triangles there have no area, and those that reach over the border are squeezed into the image. As columns and rows
 * keep their order, no triangle turns over, and they cover the image as they covered the square. All but the four corners bisect an edge of the
 * next coarser triangulation. With s the largest power of two that divides x and y, a vertex is
 *   a centre   (x/s and y/s are odd): it bisects the diagonal of the block of side 2s around it;
 *   a midpoint (one of them is odd): it bisects the edge from s before to s after, along x or along y.
 * A block's diagonal runs from its upper left to its lower right corner (`main`) where the sum of its column and row
 * is even, so that all diagonals of four blocks meet in their parent's centre.
 * The two triangles that share the bisected edge are the vertex's sides: side A lies above (or left of an edge along
 * y), side B below (or right). Splitting a side makes two triangles, the sides of two further vertices that face this
 * one: its children. A midpoint's are the centres at (+-s/2, +-s/2), a centre's the midpoints at (+-s, 0) and (0, +-s).
 * In a triangulation without cracks a vertex is active only if all vertices whose child it is are.
 *
 * A sample covers its pixel: vertices at outermost samples are drawn half a pixel farther out, with the nearness
 * that samples.cl places there. What the tree tells of its vertices (states, errors) is told of the samples.
 *
 * Points of triangles are kept as (a, b, c): of a perspective view (x z, y z, z), of an orthographic one (x, y, -z).
 * With a 1 they are homogeneous: a 4x4 map takes them to another camera's pixel space.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"
#include "lib/surface.h"
#include "lib/vectors.h"

/* A triangle's state: bits of what cells within it are, 0 where there is no triangle. Side A has the lower two bits
 * of a vertex's byte and side B the next two; in a cell's byte the upper triangle is A, the lower one B. */
#define UNDRAWN 1
#define DRAWN 2
#define SIDE_BITS 2
#define STATE_A(byte) ((byte) & 3)
#define STATE_B(byte) ((byte) >> SIDE_BITS & 3)

typedef struct {
    float ray[6];    /* the sample (x, y) lies on (ray[0] x + ray[1] y + ray[2], ray[3] x + ray[4] y + ray[5], 1) z, or, seen
                        by an orthographic camera, at these x and y with its own z */
    float footprint; /* of a sample, in scene units: at depth 1, or everywhere */
    float noise[3];  /* at depth z the depths have a standard deviation of a z z + b z + c; 0 where it is not known */
    int perspective;
    int width, height; /* samples */
    int pitch;         /* samples from one row to the next */
    int side;          /* cells along the tree's side */
    int row;           /* vertices from one row of the tree to the next */
} Layout;

#define IS_SAMPLE(nearness) ((nearness) > 0.5f * NO_SURFACE)

/* The sample (x, y) with depth z in the view's camera's frame */
Vector point_of(const Layout *layout, floatl x, floatl y, floatl z)
{
    const float *r = layout->ray;
    const floatl scale = layout->perspective ? z : (floatl)1.0f;
    const Vector p = {(r[0] * x + r[1] * y + r[2]) * scale, (r[3] * x + r[4] * y + r[5]) * scale, z};
    return p;
}

/* How far out of the image the vertex at a sample is drawn: x of `count` columns, or y of `count` rows */
INLINED floatl beyond_sample(intl x, int count)
{
    return select_lanes(x == 0, (floatl)-BORDER, select_lanes(x == count - 1, (floatl)BORDER, (floatl)0.0f));
}

/* Where it is drawn: the number of the sample plus that */
float place_of(int x, int count)
{
    return x + (x == 0 ? -BORDER : x == count - 1 ? BORDER : 0.0f);
}

/* Does the diagonal of the block of side 2s with the centre (x, y) run to the lower right? */
#define IS_MAIN(x, y, s) (!(((x) ^ (y)) & (2 * (s))))

/* The step of a vertex: the largest power of two in x and in y */
int step_of(int x, int y)
{
    return (x | y) & -(x | y);
}

#define IS_CENTER(x, y, s) (((x) & (y) & (s)) != 0)

/* Which centres of step s are of blocks that reach over the last column or row, and so are squeezed into the image? */
INLINED intl is_squeezed(const Layout *layout, intl x, intl y, int s)
{
    return (x + s >= layout->width) | (y + s >= layout->height);
}

/* LANES numbers of a row from first + dx on, dx in {-1, 0, 1}; the first of a row's has no left neighbour. */
#define NEXT_TO(load, row, first, dx) ((dx) < 0 && !(first) ? shifted_lanes(load(row)) : load((row) + (first) + (dx)))

/* The byte of the cell at (dx, dy), each -1 or 0, from the vertices x of a row y; 0 beyond the image */
intl cell_next_to(const Layout *layout, global const uchar *cells, intl x, int first, int y, int dx, int dy)
{
    if (y + dy < 0 || y + dy >= layout->height - 1)
        return (intl)0;
    const intl byte = NEXT_TO(load_bytes, cells + (size_t)(y + dy) * layout->pitch, first, dx);
    return select_lanes((x + dx >= 0) & (x + dx < layout->width - 1), byte, (intl)0);
}

/* Of depths: by less than that part of their sum, three points of a straight line lie off it. Such errors are none. */
#define ROUNDING 0x1p-22f

/* Marks of vertices of a triangulation: all corners of triangles, and of them those where right angles may be */
#define LISTED 2
#define ACTIVE 3
#define IS_ACTIVE(mark) ((mark) == ACTIVE)

/* Marks the four corners of the tree, of which two are at the coarsest triangles' right angles. */
void mark_corners(const Layout *layout, global uchar *active, int y)
{
    if (y > 0 && y < layout->side)
        return;
    global uchar *row = active + (size_t)y * layout->row;
    row[y] = LISTED;
    row[layout->side - y] = ACTIVE;
}
#endif
