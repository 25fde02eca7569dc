#ifndef LIB_VECTORS_H
#define LIB_VECTORS_H
/* Points and directions in space, one per lane. */
#include "lib/lanes.h"

typedef struct {
    floatl x, y, z;
} Vector;

#define DOT(a, b) ((a).x * (b).x + (a).y * (b).y + (a).z * (b).z)

/* One component (`row`) of matrix m times the point p */
#define POINT_ROW(m, row, p)                                                                                   \
    ((m)[4 * (row)] * (p).x + (m)[4 * (row) + 1] * (p).y + (m)[4 * (row) + 2] * (p).z + (m)[4 * (row) + 3])

INLINED Vector vector_at(global const float *vectors, intl number)
{
    Vector v;
    gather_pairs(vectors, 3 * number, &v.x, &v.y);
    v.z = (floatl)(gather(vectors, 3 * number + 2));
    return v;
}

INLINED Vector minus(Vector a, Vector b)
{
    const Vector d = {a.x - b.x, a.y - b.y, a.z - b.z};
    return d;
}

/* a + t b */
INLINED Vector plus_scaled(Vector a, floatl t, Vector b)
{
    const Vector sum = {a.x + t * b.x, a.y + t * b.y, a.z + t * b.z};
    return sum;
}

/* s a + t b */
INLINED Vector combined(floatl s, Vector a, floatl t, Vector b)
{
    const Vector sum = {s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z};
    return sum;
}

INLINED Vector scaled(Vector v, floatl by)
{
    const Vector s = {v.x * by, v.y * by, v.z * by};
    return s;
}

INLINED Vector cross_product(Vector a, Vector b)
{
    const Vector c = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return c;
}

INLINED Vector normalized(Vector v)
{
    return scaled(v, 1.0f / sqrt(max_lanes(DOT(v, v), (floatl)1e-30f)));
}
#endif
