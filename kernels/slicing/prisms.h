#ifndef SLICING_PRISMS_H
#define SLICING_PRISMS_H
/* Prisms of a displacement volume, set up for a region of pixels (Kautz & Seidel 2001, section 3).
 *
 * A prism's frame has its origin at the first corner of the base triangle. Its axes are the vectors to the second and
 * third corner, and one along the triangle's normal, as long as the displacement. Coordinates in the frame, the prism's
 * bounding planes and the numbers of planar slices are each a `Quantity`. prism_rays.h turns coordinates in the frame
 * into a height and weights of the corners. For each prism, this file chooses one of the triangle's slicing directions
 * (section 3.2). Arrays: surface.cl.
 */
#include "lib/heights.h"
#include "lib/taps.h"
#include "raster/fragment.h"
#include "slicing/rays.h"

/* The alpha test (sections 3.1 and 3.2): alpha is the map's value, h the height of the tested point, both 0 to 1 */
#define AT_LEAST 0 /* alpha >= h: the inside is filled, and the base is drawn (Dietrich) */
#define BAND 1     /* h <= alpha < h + band: gaps open between samples that differ by more than the band (Schaufler) */
#define INSIDE 2   /* alpha > h: where alpha is 0 there is nothing (Kautz & Seidel) */

#define STEADY_PARTS 12.0f /* most slices per pixel width along a ray, where few slices would miss thin parts */
#define CELLS_PER_SLICE 1.6f /* a slice takes as long as these cells */
#define SURFACE 0
#define ORTHOGONAL 1
#define SCREEN 2
#define PRISM_CORNERS 6 /* three of the base, and the three above them */
#define PRISM_PLANES 5  /* bounding planes: below, above, and one along each side of the triangle */
#define OUTLINES_MAX 6
#define TILT_FLOATS 9     /* floats per triangle in `tilts` */
#define SIDE_MARGIN 1e-5f /* fraction of a prism's size by which its bounding planes are moved outwards */
#define HEIGHT_ROUNDING 1e-5f /* fraction of the displacement: lower heights count as the base */
#define ROUNDING_ULPS 8.0f /* rounding error of coordinates, in units of the last place */
#define SLICE_ROUNDING 1e-4f /* rounding error of a slice number where a ray enters or leaves a prism */

typedef struct {
    global const int *corners;
    global const float *projected, *points, *uv, *frames, *tilts;
    global const int *ends;
    global const uint *heights;
    global const float *gradients;
    Screen screen;
    float nearest_w, spacing;
    float pixel; /* width of a pixel at depth 1, in scene units; 0: the number of slices is fixed */
    float band;  /* the test BAND's range of heights, as a fraction of the displacement; 0: one slice spacing */
    int slices, slicing, test, halvings, map_width, map_height;
    global int *counters;
} Context;

/* A number that depends on a point's pixel (px, py) and nearness: x px + y py + one + n * nearness, multiplied by the
 * depth in a perspective picture. Along a ray it is linear in depth (`Linear`). In a perspective picture, `fixed` is
 * the same for all pixels; in an orthographic picture, `sloped` is. */
typedef struct {
    float x, y, one, n;
} Quantity;

/* A corner's vector from the base to the top, in the prism's frame */
typedef struct {
    float second, third, rise;
} Tilt;

/* Coefficients from which prism_rays.h computes heights. first: the first corner's tilt; to_second, to_third: the
 * second and third corner's tilt minus the first's */
typedef struct {
    Tilt first, to_second, to_third;
    float area_1, area_2;     /* a slice's area, divided by the base's, is 1 + h area_1 + h^2 area_2 */
    float second_2, third_2;  /* coefficients of h^2 in the numerators of the corners' weights */
    float by_second, by_third; /* coefficients of h^2 x and h^2 y in the cubic; x, y: the point's coordinates */
    float square, cube;       /* coefficients of h^2 alone and h^3 alone in the cubic */
} Bend;

typedef struct {
    Quantity second, third, rise; /* coordinates in the frame */
    Quantity slice;               /* slice number, if slices are planes */
    Bend bend;
    float u, v, u_second, v_second, u_third, v_third; /* u, v at the first corner; differences at the other corners */
    Quantity sides[PRISM_PLANES]; /* nearness at which a pixel's ray crosses each plane */
    int leaves[PRISM_PLANES];     /* whether a ray towards the camera leaves the prism there */
#if BLOCK > 1
    Quantity outline[OUTLINES_MAX]; /* positive at the first pixel of a block that may show the prism */
    int outlines;
#endif
    float nearest, front, rear; /* nearness of the near plane, of the nearest corner and of the farthest corner */
    float first, last;          /* nearness a little behind the farthest corner, and in front of the nearest corner */
    int index, perspective, crosses; /* crosses: the near plane cuts the prism */
    int by_height;         /* 1: a slice has the same height everywhere; 0: slices are planes */
    float count;           /* number of slices through the displacement, with by_height */
    float spacing, band;   /* distance between slices, scene units; `band` of the test BAND, > 0 */
    float height_rounding; /* rounding error of heights, as a fraction of the displacement */
    float share_rounding;  /* rounding error of barycentric weights; at least height_rounding */
    float slice_rounding;  /* rounding error of slice numbers; at least SLICE_ROUNDING */
    int halvings; /* bisections of the interval between two slices */
    int ends;     /* 1: a ray that leaves the prism may leave the surface */
    int by_cells; /* 1: rays are intersected with the map's cells, without slices */
    Tilt lengths; /* with by_cells: the frame's axes in scene units */
} Prism;

typedef struct {
    Prism of[LANES];
    intl low_x, high_x, low_y, high_y;
} Primitives;

/* Bilinear height at (u, v), 0 to 1, from a tiled or clamped map; heights: lib/heights.h. u and v are wrapped before
 * they are scaled, which is exact for any number of tiles. */
floatl height_at(global const uint *heights, int width, int height, floatl u, floatl v)
{
    const HeightMap map = {width, height, 0};
    const Taps taps = map_taps(width, height, u, v);
    return height_of(read_patch(heights, map, taps.column, taps.row), taps.fx, taps.fy) * HEIGHT_UNIT;
}

/* Returns whether a point of height h passes the alpha test where the map's value is alpha. */
intl passes(int test, floatl alpha, floatl h, float band)
{
    if (test == AT_LEAST)
        return alpha >= h;
    if (test == INSIDE)
        return alpha > h;
    return (alpha >= h) & (alpha < h + band);
}

/* Sets the barycentric coordinates of a tetrahedron with the corners p: rows of the inverse of the matrix of corners.
 * Returns 0 if the corners are coplanar. */
int barycentric_rows(const float4 *p, Quantity *rows)
{
    float determinant = 0.0f;
    for (int k = 0; k < 4; k++) {
        const float4 a = p[(k + 1) & 3], b = p[(k + 2) & 3], c = p[(k + 3) & 3];
        const float bc_zw = b.z * c.w - b.w * c.z, bc_yw = b.y * c.w - b.w * c.y, bc_yz = b.y * c.z - b.z * c.y;
        const float bc_xw = b.x * c.w - b.w * c.x, bc_xz = b.x * c.z - b.z * c.x, bc_xy = b.x * c.y - b.y * c.x;
        const float sign = k & 1 ? -1.0f : 1.0f;
        rows[k].x = sign * (a.y * bc_zw - a.z * bc_yw + a.w * bc_yz);
        rows[k].y = -sign * (a.x * bc_zw - a.z * bc_xw + a.w * bc_xz);
        rows[k].one = sign * (a.x * bc_yw - a.y * bc_xw + a.w * bc_xy);
        rows[k].n = -sign * (a.x * bc_yz - a.y * bc_xz + a.z * bc_xy);
        if (k == 0)
            determinant = rows[0].x * p[0].x + rows[0].y * p[0].y + rows[0].one * p[0].z + rows[0].n * p[0].w;
    }
    if (determinant == 0.0f || !isfinite(determinant))
        return 0;
    const float inverse = 1.0f / determinant;
    for (int k = 0; k < 4; k++) {
        rows[k].x *= inverse;
        rows[k].y *= inverse;
        rows[k].one *= inverse;
        rows[k].n *= inverse;
    }
    return 1;
}

Quantity from_corners(const Quantity *rows, float4 values)
{
    Quantity made;
    made.x = rows[0].x * values.x + rows[1].x * values.y + rows[2].x * values.z + rows[3].x * values.w;
    made.y = rows[0].y * values.x + rows[1].y * values.y + rows[2].y * values.z + rows[3].y * values.w;
    made.one = rows[0].one * values.x + rows[1].one * values.y + rows[2].one * values.z + rows[3].one * values.w;
    made.n = rows[0].n * values.x + rows[1].n * values.y + rows[2].n * values.z + rows[3].n * values.w;
    return made;
}

/* Sets the spacing of a prism's slices. Along a ray, slices are one pixel width apart, measured at the prism's nearest
 * corner. If fewer than SLICES_STEADY slices fit into the displacement, slices are closer, so that thin parts do not
 * flicker: at most STEADY_PARTS per pixel width. Wider spacings get more bisections, so that hits stay within
 * 1 / PIXEL_PARTS of a pixel of the surface. Rays are intersected with the map's cells instead if texels are larger
 * than pixels, or if that takes no longer; not with the test BAND, whose slices are at least half a texel apart. base:
 * corners of the prism's triangle; view: the direction of a ray, of length 1; facing: the cosine of the angle between
 * it and the slices' normal */
void space_slices(const Context *context, Prism *t, const float3 *base, float3 view, float facing)
{
    t->spacing = context->spacing;
    t->halvings = context->halvings;
    t->by_cells = 0;
    t->band = context->band > 0.0f ? context->band : 1.0f / context->slices;
    if (context->pixel == 0.0f)
        return;
    const float pixel = context->pixel * (t->perspective ? 1.0f / t->front : 1.0f);
    const float scale = context->spacing * context->slices;
    global const float *g = context->gradients + t->index * 6;
    const float3 along_u = vload3(0, g) * (float)context->map_width;
    const float3 along_v = vload3(1, g) * (float)context->map_height;
    const float texels = fmax(fmax(fast_length(along_u), fast_length(along_v)), 1e-30f); /* per scene unit */
    const float pixel_spacing = pixel * facing;
    t->spacing = fmax(fmin(pixel_spacing, fmax(pixel_spacing / STEADY_PARTS, scale / SLICES_STEADY)),
                      scale / SLICES_MAX);
    const float cells = fabs(dot(along_u, view)) + fabs(dot(along_v, view));
    t->by_cells = context->test != BAND && (pixel * texels < 1.0f || cells * t->spacing < CELLS_PER_SLICE * facing);
    if (context->test == BAND)
        t->spacing = fmax(t->spacing, fmin(0.5f / texels, scale));
    if (context->band == 0.0f)
        t->band = t->spacing / scale;
    const float parts = t->spacing * fmax(PIXEL_PARTS / pixel, TEXTURE_PARTS / scale);
    t->halvings = max(context->halvings, min((int)ceil(log2(fmax(parts, 1.0f))), HALVINGS_MAX));
    if (t->by_cells) /* points in cells are exact */
        t->halvings = t->ends = 0;
    t->lengths = (Tilt){length(base[1] - base[0]), length(base[2] - base[0]), scale};
}

/* The rounding error of a coordinate in the prism's frame. The coordinate of a ray's point is a difference of two
 * numbers as large as the ray's length in the frame; the pixel's coordinates are rounded, too. x, y: the region's first
 * pixel */
float rounding_of(const Prism *t, const Quantity *q, int x, int y)
{
    const float by_x = fabs(q->x) * (x + REGION), by_y = fabs(q->y) * (y + REGION);
    const float along = fabs(q->n) * (t->perspective ? 1.0f : fmax(fabs(t->front), fabs(t->rear)));
    const float across = (by_x + by_y) * (t->perspective ? 1.0f / fmax(t->rear, 1e-30f) : 1.0f);
    return fmin(fmax(ROUNDING_ULPS * FLT_EPSILON * (along + across), HEIGHT_ROUNDING), 1.0f);
}

/* Sets the coefficients for heights, from the determinant and cofactors of the linear system in prism_rays.h. */
INLINED void set_bend(Bend *bend, global const float *tilts)
{
    const float3 one = vload3(0, tilts), two = vload3(1, tilts) - one, three = vload3(2, tilts) - one;
    bend->first = (Tilt){one.x, one.y, one.z};
    bend->to_second = (Tilt){two.x, two.y, two.z};
    bend->to_third = (Tilt){three.x, three.y, three.z};
    bend->area_1 = two.x + three.y;
    bend->area_2 = two.x * three.y - three.x * two.y;
    bend->second_2 = one.y * three.x - one.x * three.y;
    bend->third_2 = one.x * two.y - one.y * two.x;
    bend->by_second = two.z * three.y - three.z * two.y;
    bend->by_third = three.z * two.x - two.z * three.x;
    bend->square = one.z * bend->area_1 - two.z * one.x - three.z * one.y;
    bend->cube = one.z * bend->area_2 + two.z * bend->second_2 + three.z * bend->third_2;
}

/* Sets the planes that bound a prism: two parallel to its base, and one through each side of its base triangle. A
 * side's plane leans outwards until the two corners above the side lie within, and is moved outwards if any other
 * corner lies outside. rows: barycentric coordinates in the frame */
void set_planes(Prism *t, const Quantity *rows, global const float *tilts)
{
    float3 tilt[3];
    for (int k = 0; k < 3; k++)
        tilt[k] = vload3(k, tilts);
    const float low = fmin(fmin(0.0f, tilt[0].z), fmin(tilt[1].z, tilt[2].z));
    const float high = fmax(fmax(0.0f, tilt[0].z), fmax(tilt[1].z, tilt[2].z));
    t->sides[0] = from_corners(rows, (float4)(-low, -low, -low, 1.0f - low));
    t->sides[1] = from_corners(rows, (float4)(high, high, high, high - 1.0f));
    for (int side = 0; side < 3; side++) { /* a side has the number of the corner opposite to it */
        float moved[3]; /* by how much the weight of corner `side` grows from each corner to the corner above it */
        for (int k = 0; k < 3; k++)
            moved[k] = side == 0 ? -tilt[k].x - tilt[k].y : (side == 1 ? tilt[k].x : tilt[k].y);
        const int l = side == 0 ? 1 : 0, m = side == 2 ? 1 : 2;
        const int stands = tilt[l].z > 1e-3f && tilt[m].z > 1e-3f;
        const float lean = stands ? fmin(moved[l] / tilt[l].z, moved[m] / tilt[m].z) : 0.0f;
        float out = 0.0f;
        for (int k = 0; k < 3; k++)
            out = fmax(out, lean * tilt[k].z - moved[k] - (k == side ? 1.0f : 0.0f));
        const float4 of_frame = (float4)(side == 0, side == 1, side == 2, (side == 0) - lean);
        t->sides[2 + side] = from_corners(rows, of_frame + out);
    }
}

/* Moves the bounding planes outwards by `grown`, and sets where rays cross each of them. Sets the prism's outline in
 * the picture: lines where a plane through which rays enter meets a plane through which they leave. */
void bound_sides(Prism *t, float grown)
{
    for (int k = 0; k < PRISM_PLANES; k++) {
        const Quantity row = t->sides[k];
        const float n = fabs(row.n) > 1e-30f ? row.n : 1e-30f; /* 0: seen edge-on */
        t->sides[k] = (Quantity){-row.x / n, -row.y / n, -(row.one + grown) / n, 0.0f};
        t->leaves[k] = n < 0.0f;
    }
#if BLOCK > 1
    t->outlines = 0;
    for (int k = 0; k < PRISM_PLANES; k++)
        for (int l = 0; l < PRISM_PLANES; l++)
            if (t->leaves[k] && !t->leaves[l]) {
                Quantity o = {t->sides[k].x - t->sides[l].x, t->sides[k].y - t->sides[l].y,
                              t->sides[k].one - t->sides[l].one, 0.0f};
                o.one += (fmax(o.x, 0.0f) + fmax(o.y, 0.0f)) * (BLOCK - 1);
                t->outline[t->outlines++] = o;
            }
#endif
}

/* The direction of the ray through a pixel; its length is not 1. */
float3 direction_at(Screen screen, float x, float y)
{
    const float *m = screen.to_world;
    if (!screen.perspective)
        return (float3)(m[3], m[7], m[11]);
    return (float3)(PIXEL_ROW(m, 0, x, y), PIXEL_ROW(m, 1, x, y), PIXEL_ROW(m, 2, x, y));
}

/* Chooses the direction, spacing and numbers of a prism's slices. view: direction of the ray through the middle of the
 * part of the prism in the bin; base: corners of its triangle; across: the frame's third axis */
void set_slices(const Context *context, Prism *t, const Quantity *rows, float3 view, const float3 *base, float3 across,
                float first_depth)
{
    int direction = 0; /* direction a */
    float3 d = vload3(t->index * 3, context->frames);
    float facing = fabs(dot(d, view)); /* cosine times the length of `view` */
    if (context->slicing == ORTHOGONAL) /* the direction that faces the viewer most */
        for (int k = 1; k < 3; k++) {
            const float3 other = vload3(t->index * 3 + k, context->frames);
            if (fabs(dot(other, view)) > facing) {
                facing = fabs(dot(other, view));
                direction = k;
                d = other;
            }
        }
    space_slices(context, t, base, normalize(view), context->slicing == SCREEN ? 1.0f : facing / length(view));
    t->by_height = context->slicing != SCREEN && direction == 0;
    t->count = context->pixel == 0.0f ? context->slices : context->slices * (context->spacing / t->spacing);
    t->slice_rounding = SLICE_ROUNDING;
    /* Slice numbers are relative to the whole number closest to the first corner's, because small numbers are rounded
     * less. */
    const float along = 1.0f / t->spacing;
    if (context->slicing == SCREEN) {
        const float off = rint(first_depth * along);
        t->slice = t->perspective ? (Quantity){0.0f, 0.0f, along, -off} : (Quantity){0.0f, 0.0f, -off, -along};
    } else if (t->by_height)
        t->slice_rounding = fmax(SLICE_ROUNDING, fmin(t->height_rounding * t->count, 0.5f));
    else {
        const float first = dot(base[0], d) * along;
        const float4 beside = (float4)(0.0f, dot(base[1] - base[0], d), dot(base[2] - base[0], d), dot(across, d));
        t->slice = from_corners(rows, (first - rint(first)) + beside * along);
    }
}

/* The middle of the part of a prism in a bin. low, high: the prism's box in the picture. Coordinates are relative to
 * the region at (x, y), which is the bin or a pixel of it */
INLINED float2 middle_in_bin(float2 low, float2 high, int x, int y)
{
    const float2 bin = (float2)(-(x % BIN), -(y % BIN));
    return 0.5f * (clamp(low, bin, bin + (BIN - 1.0f)) + clamp(high, bin, bin + (BIN - 1.0f)));
}

/* Sets up a prism. Returns its box of pixels in the region at (x, y): (low_x, high_x, low_y, high_y); low > high if the
 * prism is not visible */
static int4 set_up_one(const Context *context, int index, int x, int y, Prism *t)
{
    const int4 empty = (int4)(1, 0, 1, 0);
    float4 p[PRISM_CORNERS];
    int crosses = 0;
    for (int k = 0; k < PRISM_CORNERS; k++) {
        p[k] = vload4(context->corners[PRISM_CORNERS * index + k], context->projected);
        p[k].xy -= (float2)(x, y) * p[k].z; /* pixels relative to the region's first pixel */
        crosses |= !(p[k].z >= context->nearest_w);
    }
    int4 box = (int4)(0, REGION - 1, 0, REGION - 1);
    float2 low = -BIN, high = BIN;
    if (!crosses) {
        low = high = p[0].xy / p[0].z;
        for (int k = 1; k < PRISM_CORNERS; k++) {
            low = fmin(low, p[k].xy / p[k].z);
            high = fmax(high, p[k].xy / p[k].z);
        }
        const float2 first = fmin(fmax(ceil(low - 1e-3f), 0.0f), (float)REGION);
        const float2 last = fmin(fmax(floor(high + 1e-3f), -1.0f), REGION - 1.0f);
        box = (int4)((int)first.x, (int)last.x, (int)first.y, (int)last.y);
        if (box.x > box.y || box.z > box.w)
            return empty;
    }
    /* The frame's corners in the picture: the triangle's three, and a fourth above the first. */
    const float3 across = vload3(index * 3, context->frames) * (context->spacing * context->slices);
    const float *m = context->screen.from_world;
    float up_row[4]; /* `across` in pixel space */
    for (int row = 0; row < 4; row++)
        up_row[row] = m[4 * row] * across.x + m[4 * row + 1] * across.y + m[4 * row + 2] * across.z;
    float4 up = (float4)(up_row[0], up_row[1], up_row[2], up_row[3]);
    up.xy -= (float2)(x, y) * up.z;
    const float4 frame[4] = {p[0], p[1], p[2], p[0] + up};
    Quantity rows[4];
    if (!barycentric_rows(frame, rows))
        return empty;
    float3 base[3];
    float2 uv[3];
    for (int k = 0; k < 3; k++) {
        const int corner = context->corners[PRISM_CORNERS * index + k];
        base[k] = vload3(corner, context->points);
        uv[k] = vload2(corner, context->uv);
    }
    t->u = uv[0].x, t->v = uv[0].y;
    t->u_second = uv[1].x - uv[0].x, t->v_second = uv[1].y - uv[0].y;
    t->u_third = uv[2].x - uv[0].x, t->v_third = uv[2].y - uv[0].y;
    t->second = rows[1], t->third = rows[2], t->rise = rows[3];
    t->perspective = context->screen.perspective;
    t->index = index;
    t->ends = context->slicing != SURFACE && (context->test != BAND || context->band >= 1.0f) &&
              context->ends[index];
    t->crosses = crosses;
    t->nearest = t->front = context->screen.nearest;
    t->rear = t->perspective ? 0.0f : -INFINITY;
    if (!crosses) {
        t->front = t->rear = p[0].w / p[0].z;
        for (int k = 1; k < PRISM_CORNERS; k++) {
            t->front = fmax(t->front, p[k].w / p[k].z);
            t->rear = fmin(t->rear, p[k].w / p[k].z);
        }
    }
    t->height_rounding = crosses ? HEIGHT_ROUNDING : rounding_of(t, &t->rise, x, y);
    t->share_rounding = t->height_rounding;
    if (!crosses)
        t->share_rounding = fmax(t->share_rounding,
                                 fmax(rounding_of(t, &t->second, x, y), rounding_of(t, &t->third, x, y)));
    const float2 middle = middle_in_bin(low, high, x, y);
    set_slices(context, t, rows, direction_at(context->screen, x + middle.x, y + middle.y), base, across,
               t->perspective ? p[0].z : -p[0].w);
    set_bend(&t->bend, context->tilts + TILT_FLOATS * index);
    set_planes(t, rows, context->tilts + TILT_FLOATS * index);
    bound_sides(t, crosses ? 0.0f : SIDE_MARGIN / p[0].z); /* so that rounding leaves no gap between neighbours */
    const float margin = 1e-4f * (t->front - t->rear) + 2e-6f * fmax(fabs(t->front), fabs(t->rear));
    t->first = crosses ? t->rear : t->rear - margin;
    t->last = crosses ? t->nearest : fmin(t->front + margin, t->nearest);
    return box;
}

static intl set_up(const Context *context, intl index, int x, int y, Primitives *made)
{
    for (int lane = 0; lane < LANES; lane++) {
        const int4 box = set_up_one(context, int_lane(index, lane), x, y, &made->of[lane]);
        set_int_lane(made->low_x, lane, box.x);
        set_int_lane(made->high_x, lane, box.y);
        set_int_lane(made->low_y, lane, box.z);
        set_int_lane(made->high_y, lane, box.w);
    }
    return made->low_x <= made->high_x;
}

#endif
