#ifndef RELIEF_WALK_H
#define RELIEF_WALK_H
/* A ray's walk through a relief: the ray is followed through the prisms below the mesh's triangles.
 *
 * At each corner P of a triangle, a vector N leads from the relief's bottom to P. A point below the triangle is
 * X = P - h N, where P and N are interpolated with the same weights and h is the point's depth, 1 at the bottom. The
 * points below a triangle form a prism; all prisms together fill the relief without gaps. A ray is followed from prism
 * to prism, in one leg or several, until it leaves a prism at the bottom, at the mesh, or at a border of the mesh.
 *
 * The points of a prism at one depth form a triangle, the section at this depth, which a ray crosses once. So within a
 * prism, the depth determines the ray's point. With each side of the section, this point forms a triangle. The areas of
 * these three triangles, seen along the ray and divided by their sum, are the corners' weights. Each area is a
 * polynomial of degree two in the depth; the ray leaves through the side whose area first becomes 0. The ray sinks
 * where it meets sections from the front, and rises where it meets them from behind. Two neighbouring prisms compute
 * the same area for their common side, so no ray is lost between them.
 *
 * Deeper than a centre of curvature, prisms are inside out and overlap others. Depth is continuous there, too: the walk
 * goes backwards along the ray, and comes out on the other side of a sharp bend.
 *
 * prisms: (triangles, PRISM_FLOATS) P, N, u and v of each corner; then three integers, one for the side opposite to
 * each corner: the same side in the neighbouring triangle, as 3 * triangle + corner, or -1 at a border of the mesh.
 * Beyond a border, u and v continue linearly, and the depth changes as if the normals went on turning as in the last
 * prism.
 */
#include "relief/entry.h"

#define PRISM_FLOATS 28
#define LEGS_MAX 512       /* most legs of a ray; nearly all rays take less than ten */
#define LEAST 1e-30f       /* least divisor */
#define SHORTEST 1e-18f    /* scene units: shorter legs count as this long in divisions */
#define SHORTEST_CUT 0.02f /* change of depth: shorter legs are not cut */
#define SLACK 1.01f        /* a leg that is too long by less than this factor, as by rounding, is not cut */
#define UNEVEN 0.2f        /* fraction of a leg: the mean depth's place is clamped to this distance from the middle */
/* Texels: greatest error of u and v. With larger errors in a light's map, reliefs would shade themselves. */
#define BEND_MAX (DEPTH_ALONE ? 0.025f : 0.1f)
#define TEXELS_MIN 16.0f /* columns or rows: for BEND_MAX, smaller maps count as this large */

/* A triangle's prism: P (relative to a ray's entry), N, u and v of its corners. Points and vectors have z along the
 * ray. */
typedef struct {
    Vector point[3], normal[3];
    floatl u[3], v[3];
    intl beside[3];
} MeshPrism;

/* Twice the areas of the triangles that the ray's point forms with a section's sides: area + slope x + bend x^2, if the
 * depth has changed by the amount x >= 0. Index: the corner opposite to the side */
typedef struct {
    floatl area[3], slope[3], bend[3];
    floatl sign; /* 1 if the ray sinks, or -1 */
} SideAreas;

/* A ray's crossing with a section: the section's second and third corner's weights, and the distance from the entry */
typedef struct {
    floatl second, third, distance;
} Crossing;

typedef struct {
    Vector from, direction;
    floatl reached; /* distance from the entry */
    intl triangle, enters;          /* the ray's triangle; rays that have just come to it */
    floatl depth;                   /* depth at this distance */
    intl active;                    /* rays that are followed */
    intl is_beyond, ends_at_border; /* rays that are beyond a border; rays that end at borders */
    intl side;   /* side through which the ray enters, later leaves the prism; -1: through the mesh or the bottom */
    intl beside; /* the same side in the neighbouring triangle, or -1, as in `prisms` */
    floatl leg, way, end;                      /* the leg's length, direction (1 or -1), and depth at its end */
    floatl second, third, by_second, by_third; /* corners' weights, and their change per scene unit of the leg */
    floatl rest;    /* change of depth until the ray leaves its prism */
    intl leaves_by; /* the side through which it leaves, as `side` */
    intl is_cut;    /* legs that end within their prisms */
    floatl cut;     /* greatest change of depth along a leg in this prism, or NEVER */
    floatl pixel_size;    /* scene units at the entry; 0: the finest level is read */
    intl level, tier;     /* level of the map, and tier of the search (search.h) */
    floatl columns, rows; /* the level's columns and rows, for BEND_MAX */
} MeshWalk;

INLINED MeshPrism prism_of(const Relief *relief, intl triangle, Vector from, Vector z)
{
    MeshPrism p;
    floatl row[PRISM_FLOATS];
    const int one = int_lane(triangle, 0), uniform = !any_lane(triangle != one);
    UNROLLED
    for (int i = 0; i < PRISM_FLOATS; i += 4) {
        if (uniform) {
            const float4 part = vload4((PRISM_FLOATS * one + i) / 4, relief->prisms);
            row[i] = part.x;
            row[i + 1] = part.y;
            row[i + 2] = part.z;
            row[i + 3] = part.w;
        } else
            gather_rows(relief->prisms, triangle * (PRISM_FLOATS / 4) + i / 4, row + i);
    }
    /* Two axes at right angles to the ray and to each other (Duff et al. 2017) */
    const floatl sign = select_lanes(z.z < 0.0f, (floatl)-1.0f, (floatl)1.0f), a = -1.0f / (sign + z.z), b = z.x * z.y * a;
    const Vector x = {1.0f + sign * z.x * z.x * a, sign * b, -sign * z.x}, y = {b, sign + z.y * z.y * a, -z.y};
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const floatl *corner = row + 8 * k;
        const Vector point = {corner[0] - from.x, corner[1] - from.y, corner[2] - from.z},
                     normal = {corner[3], corner[4], corner[5]};
        const Vector point_seen = {DOT(point, x), DOT(point, y), DOT(point, z)},
                     normal_seen = {DOT(normal, x), DOT(normal, y), DOT(normal, z)};
        p.point[k] = point_seen;
        p.normal[k] = normal_seen;
        p.u[k] = corner[6];
        p.v[k] = corner[7];
        p.beside[k] = as_intl(row[24 + k]);
    }
    return p;
}

/* Sets a walk's level of the map, from the number of texels that a pixel covers on the first triangle. */
INLINED void set_level(const Relief *relief, MeshWalk *walk, const MeshPrism *p)
{
    const floatl size = walk->pixel_size;
    const Vector second = minus(p->point[1], p->point[0]), third = minus(p->point[2], p->point[0]);
    const floatl E = DOT(second, second), F = DOT(second, third), G = DOT(third, third);
    const floatl u_1 = p->u[1] - p->u[0], u_2 = p->u[2] - p->u[0], v_1 = p->v[1] - p->v[0], v_2 = p->v[2] - p->v[0];
    const floatl u = G * u_1 * u_1 - 2.0f * F * u_1 * u_2 + E * u_2 * u_2,
                 v = G * v_1 * v_1 - 2.0f * F * v_1 * v_2 + E * v_2 * v_2;
    const float width = relief->levels[0], height = relief->levels[1];
    const floatl texels_2 = max_lanes(u * (width * width), v * (height * height)) * size * size / (E * G - F * F);
    walk->level = finest_level(relief, level_of_texels(texels_2, relief->level_count), size, -1);
    walk->columns = to_floatl(table_at(relief->levels, walk->level, 0)) * max(1.0f, TEXELS_MIN / width);
    walk->rows = to_floatl(table_at(relief->levels, walk->level, 1)) * max(1.0f, TEXELS_MIN / height);
}

/* Twice the signed area of the triangle of the origin and the points a and b, in the x-y plane */
#define TWICE_AREA(a, b) ((a).x * (b).y - (a).y * (b).x)

/* The areas in the section at a depth, and how they change with the depth */
INLINED SideAreas sides_at(const MeshPrism *p, floatl depth)
{
    SideAreas sides;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const Vector a = minus(p->point[i], scaled(p->normal[i], depth)),
                     b = minus(p->point[j], scaled(p->normal[j], depth));
        sides.area[k] = TWICE_AREA(b, a);
        sides.slope[k] = -TWICE_AREA(b, p->normal[i]) - TWICE_AREA(p->normal[j], a);
        sides.bend[k] = TWICE_AREA(p->normal[j], p->normal[i]);
    }
    sides.sign = select_lanes(sides.area[0] + sides.area[1] + sides.area[2] < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    UNROLLED
    for (int k = 0; k < 3; k++) {
        sides.area[k] = max_lanes(sides.sign * sides.area[k], (floatl)0.0f);
        sides.bend[k] *= sides.sign;
    }
    return sides;
}

/* A ray's crossing with the section where its depth has changed by the amount x. side: the section's side on which the
 * crossing is known to lie, or -1 */
INLINED Crossing crossing_at(const MeshPrism *p, const SideAreas *sides, floatl depth, floatl x, intl side)
{
    const floatl there = depth + sides->sign * x;
    Crossing at = {0.0f, 0.0f, 0.0f};
    floatl sum = LEAST;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const floatl area = max_lanes(sides->area[k] + x * (sides->slope[k] + x * sides->bend[k]), (floatl)0.0f),
                     inside = select_lanes(side == k, (floatl)0.0f, area);
        sum += inside;
        at.distance += inside * (p->point[k].z - there * p->normal[k].z);
        if (k == 1)
            at.second = inside;
        if (k == 2)
            at.third = inside;
    }
    const floatl share = 1.0f / sum;
    at.second *= share;
    at.third *= share;
    at.distance *= share;
    return at;
}

/* The least x >= 0 where a + b x + c x^2, with a >= 0, becomes negative, or NEVER. is_new: the ray has just entered
 * through this side, so a root at x = 0 does not count */
INLINED floatl becomes_less(floatl a, floatl b, floatl c, intl is_new)
{
    const floatl discriminant = b * b - 4.0f * a * c, root = sqrt(max_lanes(discriminant, (floatl)0.0f));
    const intl falls = b <= 0.0f, ever = (falls & (discriminant >= 0.0f) & !is_new) | (!falls & (c < 0.0f));
    const floatl x = select_lanes(falls, 2.0f * a, b + root) /
                     max_lanes(select_lanes(falls, root - b, -2.0f * c), (floatl)LEAST);
    return select_lanes(ever, x, (floatl)NEVER);
}

/* Finds where rays leave their prisms: sets `rest` and `leaves_by`. */
INLINED void find_side(const SideAreas *sides, MeshWalk *walk)
{
    const floatl depth = walk->depth;
    walk->rest = max_lanes(select_lanes(sides->sign > 0.0f, 1.0f - depth, depth), (floatl)0.0f); /* to bottom or mesh */
    walk->leaves_by = -1;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const floatl by = becomes_less(sides->area[k], sides->slope[k], sides->bend[k], walk->side == k);
        walk->leaves_by = select_lanes(by < walk->rest, (intl)k, walk->leaves_by);
        walk->rest = min_lanes(by, walk->rest);
    }
}

/* The change of an interpolated value if the second and third corner's weights change by these amounts */
#define CHANGE_OF(corners, by_second, by_third)                                                                \
    ((by_second) * ((corners)[1] - (corners)[0]) + (by_third) * ((corners)[2] - (corners)[0]))

/* The distance t to the bottom, where depth + slope t + bend t^2 is 1; if the ray never gets there, to depth 0 */
INLINED floatl way_out(floatl depth, floatl slope, floatl bend, intl *at_bottom)
{
    const floatl below = 1.0f - depth, discriminant = slope * slope + 4.0f * bend * below;
    const floatl bottom = 2.0f * below / (slope + sqrt(max_lanes(discriminant, (floatl)0.0f)));
    const floatl out = (slope + sqrt(max_lanes(slope * slope - 4.0f * bend * depth, (floatl)0.0f))) / (-2.0f * bend);
    *at_bottom = (discriminant >= 0.0f) & (bottom > 0.0f);
    return max_lanes(select_lanes(*at_bottom, bottom, out), (floatl)0.0f);
}

/* Sets up the last leg of each ray that is beyond a border: weights change linearly, and normals go on turning. */
INLINED void go_beyond(const MeshPrism *p, MeshWalk *walk, const SideAreas *sides, const Crossing *at, float scale,
                       ReliefRay *ray)
{
    const intl which = walk->is_beyond;
    floatl sum = LEAST, slopes = 0.0f, distances = 0.0f;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const floatl ahead = p->point[k].z - walk->depth * p->normal[k].z - at->distance;
        sum += sides->area[k];
        slopes += sides->slope[k];
        distances += sides->slope[k] * ahead - sides->sign * sides->area[k] * p->normal[k].z;
    }
    const floatl way = select_lanes(distances < 0.0f, (floatl)-1.0f, (floatl)1.0f), per_length = way / distances;
    const floatl second = per_length * (sides->slope[1] - slopes * at->second),
                 third = per_length * (sides->slope[2] - slopes * at->third), slope = sides->sign * per_length * sum;
    const floatl turning[3] = {p->normal[0].z, p->normal[1].z, p->normal[2].z};
    const floatl bend = -0.5f / (scale * scale) * way * CHANGE_OF(turning, second, third);
    intl at_bottom;
    const floatl leg = way_out(walk->depth, slope, bend, &at_bottom);
    walk->way = select_lanes(which, way, walk->way);
    walk->second = select_lanes(which, at->second, walk->second);
    walk->third = select_lanes(which, at->third, walk->third);
    walk->by_second = select_lanes(which, second, walk->by_second);
    walk->by_third = select_lanes(which, third, walk->by_third);
    walk->side = select_lanes(which, (intl)-1, walk->side);
    ray->L = select_lanes(which, slope, ray->L);
    ray->K = select_lanes(which, bend, ray->K);
    ray->end = select_lanes(which, leg, ray->end);
    ray->at_bottom = select_lanes(which, at_bottom, ray->at_bottom);
}

/* Sets a walk's leg, which begins at the crossing `at`. It ends where the ray leaves the prism, or is cut before. In a
 * prism u and v follow curves. The leg's u and v follow straight lines midway between the curve and its chord, at most
 * BEND_MAX from both. (The distance between them grows with the square of a leg's length.) Returns the fraction of the
 * leg where the ray has its mean depth. */
INLINED floatl set_leg(const MeshPrism *p, const SideAreas *sides, const Crossing *at, MeshWalk *walk)
{
    if (any_lane(walk->enters))
        find_side(sides, walk);
    floatl middle, off_second, off_third;
    UNROLLED
    for (int pass = 0; pass < 2; pass++) { /* the second pass is for legs that the first one cuts */
        walk->is_cut = walk->rest > walk->cut * SLACK;
        const floatl x = select_lanes(walk->is_cut, walk->cut, walk->rest);
        walk->side = select_lanes(walk->is_cut, (intl)-1, walk->leaves_by);
        const Crossing between = crossing_at(p, sides, walk->depth, 0.5f * x, (intl)-1),
                       out = crossing_at(p, sides, walk->depth, x, walk->side);
        const floatl way = out.distance - walk->reached;
        walk->end = walk->depth + sides->sign * x;
        walk->way = select_lanes(way < 0.0f, (floatl)-1.0f, (floatl)1.0f);
        walk->leg = fabs(way);
        const floatl per_leg = 1.0f / max_lanes(walk->leg, (floatl)SHORTEST);
        middle = clamp_lanes(walk->way * per_leg * (between.distance - walk->reached), (floatl)0.0f, (floatl)1.0f);
        walk->by_second = per_leg * (out.second - at->second);
        walk->by_third = per_leg * (out.third - at->third);
        off_second = between.second - at->second - middle * (out.second - at->second);
        off_third = between.third - at->third - middle * (out.third - at->third);
        const floatl bend = max_lanes(fabs(CHANGE_OF(p->u, off_second, off_third)) * walk->columns,
                                      fabs(CHANGE_OF(p->v, off_second, off_third)) * walk->rows) *
                            (0.5f / BEND_MAX);
        const intl bends = walk->active & !walk->is_beyond & (bend > 1.0f) & (x > SHORTEST_CUT);
        if (!any_lane(bends))
            break;
        const floatl part = max_lanes(x / ceil_lanes(sqrt(bend)), (floatl)SHORTEST_CUT);
        walk->cut = select_lanes(bends, part, walk->cut);
    }
    walk->second = at->second + 0.5f * off_second;
    walk->third = at->third + 0.5f * off_third;
    return clamp_lanes(middle, (floatl)(0.5f - UNEVEN), (floatl)(0.5f + UNEVEN));
}

/* Sets up a walk's next leg, and the ray that is searched on it. The ray's depth is a parabola, which is exact at the
 * leg's ends and where the depth is the mean of the ends' depths. */
static void begin_leg(const Relief *relief, MeshWalk *walk, int is_first, ReliefRay *ray)
{
    const MeshPrism p = prism_of(relief, walk->triangle, walk->from, walk->direction);
    if (is_first)
        set_level(relief, walk, &p);
    const SideAreas sides = sides_at(&p, walk->depth);
    const Crossing at = crossing_at(&p, &sides, walk->depth, (floatl)0.0f, walk->side);
    const floatl middle = set_leg(&p, &sides, &at, walk);
    const floatl deeper = walk->end - walk->depth, per_leg = 1.0f / max_lanes(walk->leg, (floatl)SHORTEST),
                 bend = deeper * (middle - 0.5f) / (middle * (1.0f - middle));
    ray->depth = walk->depth;
    ray->L = per_leg * (deeper - bend);
    ray->K = per_leg * per_leg * bend;
    ray->end = walk->leg;
    ray->at_bottom = (walk->side < 0) & (walk->end > 0.5f) & !walk->is_cut;
    if (any_lane(walk->is_beyond))
        go_beyond(&p, walk, &sides, &at, relief->scale, ray);
    walk->beside = select_lanes(walk->side == 2, p.beside[2], select_lanes(walk->side == 1, p.beside[1], p.beside[0]));
    ray->u = WRAPPED_UV(CLAMPED_U, p.u[0] + CHANGE_OF(p.u, walk->second, walk->third));
    ray->v = WRAPPED_UV(CLAMPED_V, p.v[0] + CHANGE_OF(p.v, walk->second, walk->third));
    ray->du = CHANGE_OF(p.u, walk->by_second, walk->by_third);
    ray->dv = CHANGE_OF(p.v, walk->by_second, walk->by_third);
    ray->level = walk->level;
}

/* Moves on to the next prism, or beyond a border. */
INLINED void end_leg(MeshWalk *walk)
{
    const intl passes = walk->side >= 0, crosses = passes & (walk->beside >= 0), triangle = walk->beside / 3;
    walk->reached += walk->way * walk->leg;
    walk->rest -= fabs(walk->end - walk->depth);
    const intl goes_on = walk->is_cut | (passes & (crosses | !walk->ends_at_border));
    walk->active = walk->active & goes_on & isfinite_lanes(walk->leg + walk->end);
    walk->is_beyond = !crosses & !walk->is_cut;
    walk->enters = crosses & walk->active;
    walk->cut = select_lanes(walk->is_cut, walk->cut, (floatl)NEVER);
    walk->triangle = select_lanes(crosses, triangle, walk->triangle);
    walk->depth = walk->end;
    walk->side = select_lanes(crosses, walk->beside - 3 * triangle, (intl)-1);
}
#endif
