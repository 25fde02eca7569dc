#ifndef LIB_RIBBONS_H
#define LIB_RIBBONS_H
/* Ribbons: surface for parts that are one sample wide, such as wires, leaves and bars.
 *
 * The surface of lib/surface.h ends at its last samples, so parts one sample wide have few triangles or none. A sample
 * is thin if no cell around it is whole. A thin sample is drawn as a square with the side of a sample. The square moves
 * along a straight line to each neighbour that is not torn off, and covers a ribbon; if there is no such neighbour, it
 * stays in place (a dot). If the neighbour is not thin, the ribbon ends at the neighbour's middle.
 *
 * Ribbons never cover other samples: in the pixel of a sample that a ribbon does not join, the ribbon ends before the
 * sample's position. So a view from the image's own camera equals the image. A ribbon is planar: its nearness only
 * changes along the ribbon, and equals the samples' nearness at their positions.
 *
 * In the image, an oblique wire consists of runs along rows (or columns); each run is one sample beside the previous
 * one. At the end of a run, the squares' middles are moved by half a sample towards the next run, and by less the
 * closer they are to the run's middle, so that a straight wire stays straight. To find a middle, at most 4 RUN_MAX
 * samples are read.
 */
#include "lib/surface.h"


/* All launches must compute the same ribbons to the last bit. */
#pragma OPENCL FP_CONTRACT OFF

#define RUN_MAX 32 /* greatest number of a run's samples that are read on each side; longer runs tilt by at most 1/60 */
#define NEIGHBOURS 9     /* a sample's 3 x 3 neighbours, row by row, including itself */
#define SELF 4   /* index of the sample itself */
#define CLEARANCE 0.05f /* in samples: greater than the cameras' rounding errors, and too small to be seen */

/* A ribbon between the middles of two samples. */
typedef struct {
    float x, y;        /* the first middle */
    float dx, dy;      /* vector from the first to the second middle; 0 for a dot */
    float n, gu, gv;   /* nearness at the first middle, and its gradient */
    float part, part_u, part_v; /* fraction of the way from `from` to `to`, at the first middle; its gradient */
    int ends;          /* 1: the ribbon ends at the second middle; 0: half a sample beyond it */
    int2 from, to;     /* columns and rows of the first and the second sample */
} Ribbon;

float sample_at(Grid grid, int x, int y)
{
    const int is_inside = x >= 0 && y >= 0 && x < grid.width && y < grid.height;
    return is_inside ? grid.nearness[(size_t)y * grid.pitch + x] : NO_SURFACE;
}

int joined(Grid grid, int ax, int ay, int bx, int by)
{
    const float a = sample_at(grid, ax, ay), b = sample_at(grid, bx, by);
    if (fmin(a, b) <= NO_SURFACE)
        return 0;
    if ((bx - ax) * (by - ay) == 1) /* no bit is stored for the diagonal from the upper left to the lower right */
        return !IS_OPEN(grid.cut, fmax(a, b), fmin(a, b));
    const int bit = ay == by ? TORN_RIGHT : (ax == bx ? TORN_BELOW : TORN_DIAGONAL);
    return !(as_int(sample_at(grid, min(ax, bx), min(ay, by))) & bit);
}

int is_thin(Grid grid, int x, int y)
{
    for (int cell = 0; cell < 4; cell++) {
        const int left = x - (cell & 1), top = y - (cell >> 1);
        const float q00 = sample_at(grid, left, top), q10 = sample_at(grid, left + 1, top), q01 = sample_at(grid, left, top + 1),
                    q11 = sample_at(grid, left + 1, top + 1);
        const int torn = (as_int(q00) & TORN_ALL) | (as_int(q10) & TORN_BELOW) | (as_int(q01) & TORN_RIGHT);
        if (!torn && fmin(fmin(q00, q10), fmin(q01, q11)) > NO_SURFACE)
            return 0;
    }
    return 1;
}

/* The end of the run through (x, y), in direction (dx, dy). Component x: the distance to this end in samples. Component
 * y: 1 or -1, the side on which the next run continues the wire; 0 if there is no next run. */
float2 run_end(Grid grid, int x, int y, int dx, int dy)
{
    const int aside_x = abs(dy), aside_y = abs(dx);
    for (int i = 0; i < RUN_MAX; i++, x += dx, y += dy) {
        if (joined(grid, x, y, x + dx, y + dy))
            continue;
        float step = 0.0f, reach = i + 0.5f;
        for (int side = -1; side <= 1; side += 2) {
            const int bx = x + side * aside_x, by = y + side * aside_y; /* beside the run's last sample */
            if (!joined(grid, x, y, bx + dx, by + dy))                  /* the start of the next run */
                continue;
            step += side;
            if (joined(grid, x, y, bx, by) && joined(grid, bx, by, bx + dx, by + dy))
                reach = i; /* the two runs overlap by one sample */
        }
        return (float2)(reach, step);
    }
    return (float2)(RUN_MAX, 0.0f);
}

/* The middle of the wire at sample (x, y). */
float2 middle_of(Grid grid, int x, int y)
{
    const float2 left = run_end(grid, x, y, -1, 0), right = run_end(grid, x, y, 1, 0);
    const float2 up = run_end(grid, x, y, 0, -1), down = run_end(grid, x, y, 0, 1);
    const int along_x = left.x + right.x >= up.x + down.x;
    const float2 a = along_x ? left : up, b = along_x ? right : down;
    const float per_half = 2.0f / fmax(a.x + b.x, 0.5f);
    const float aside = 0.5f * (a.y * fmax(1.0f - a.x * per_half, 0.0f) + b.y * fmax(1.0f - b.x * per_half, 0.0f));
    return along_x ? (float2)(x, y + aside) : (float2)(x + aside, y);
}

/* Tells whether there is a ribbon from thin sample (x, y) to the neighbour at offset (dx, dy). No ribbon leads to a
 * diagonal neighbour if two others lead to it around a corner. */
int is_linked(Grid grid, int x, int y, int dx, int dy)
{
    if (!joined(grid, x, y, x + dx, y + dy))
        return 0;
    if (dx == 0 || dy == 0)
        return 1;
    return !(joined(grid, x, y, x + dx, y) && joined(grid, x + dx, y, x + dx, y + dy)) &&
           !(joined(grid, x, y, x, y + dy) && joined(grid, x, y + dy, x + dx, y + dy));
}

Ribbon ribbon_of(Grid grid, int x, int y, int neighbour)
{
    const int2 from = (int2)(x, y), to = from + (int2)(neighbour % 3 - 1, neighbour / 3 - 1);
    const float2 middle = middle_of(grid, x, y);
    Ribbon ribbon = {middle.x, middle.y, 0.0f, 0.0f, sample_at(grid, x, y), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0, from, to};
    if (neighbour == SELF)
        return ribbon;
    ribbon.ends = !is_thin(grid, to.x, to.y);
    const float2 way = convert_float2(to - from);
    const float2 swept = (ribbon.ends ? convert_float2(to) : middle_of(grid, to.x, to.y)) - middle;
    ribbon.dx = swept.x;
    ribbon.dy = swept.y;
    /* The gradient's direction: along the ribbon or, if that is nearly perpendicular to the line between the samples,
     * along this line */
    const float2 along = dot(swept, way) > 0.25f ? swept : way, per_way = along / dot(along, way);
    const float rise = sample_at(grid, to.x, to.y) - ribbon.n;
    ribbon.part = dot(middle - convert_float2(from), per_way);
    ribbon.part_u = per_way.x;
    ribbon.part_v = per_way.y;
    ribbon.n += rise * ribbon.part;
    ribbon.gu = rise * per_way.x;
    ribbon.gv = rise * per_way.y;
    return ribbon;
}

/* The ribbon with a number: NEIGHBOURS times the index of its thin sample, plus the number of the neighbour at the
 * other end (SELF for a dot) */
Ribbon numbered_ribbon(Grid grid, uint number)
{
    const int sample = number / NEIGHBOURS;
    return ribbon_of(grid, sample % grid.width, sample / grid.width, number % NEIGHBOURS);
}

/* Tells whether a point of a ribbon belongs to a third sample: the point lies in this sample's pixel, and is at least
 * as far from the ribbon's line as this sample, less CLEARANCE. p: the point, relative to the first middle */
int belongs_to_another(Ribbon ribbon, float2 p)
{
    const float2 middle = (float2)(ribbon.x, ribbon.y), sample = rint(middle + p);
    const int2 at = convert_int2(sample);
    if (all(at == ribbon.from) || all(at == ribbon.to))
        return 0;
    const float2 across = (float2)(-ribbon.dy, ribbon.dx), other = sample - middle;
    const float side = dot(other, across) < 0.0f ? -1.0f : 1.0f;
    return side * dot(p - other, across) > -CLEARANCE * length(across);
}

/* Tells whether thin sample (x, y) owns the ribbon to a neighbour. A ribbon of two thin samples is owned by the first
 * one. */
int is_first_of(Grid grid, int x, int y, int neighbour)
{
    if (neighbour == SELF) {
        for (int other = 0; other < NEIGHBOURS; other++)
            if (other != SELF && is_linked(grid, x, y, other % 3 - 1, other / 3 - 1))
                return 0;
        return 1;
    }
    const int dx = neighbour % 3 - 1, dy = neighbour / 3 - 1;
    return is_linked(grid, x, y, dx, dy) && (neighbour > SELF || !is_thin(grid, x + dx, y + dy));
}
#endif
