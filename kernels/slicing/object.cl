/* Objects from images: the intersection of what each image leaves of space, by slices (Kautz & Seidel 2001,
 * sections 4 and 5).
 *
 * A pixel walks the slices of its ray's part of the object's box from front to back and stops at the first point that
 * passes the test of every view: behind the surface that the view's depth image displaces (SILHOUETTES 0), or inside
 * its silhouette (SILHOUETTES 1). A view's surface is bilinear in nearness; what it saw as background is as far as
 * FARTHEST.
 *
 * Deviations from the paper: the slices are met per pixel instead of drawn as polygons, so the stencil passes become
 * one loop; `halvings` brings the point that passes closer to the surface than its slice; `visible` asks each image what it
 * shows where the ray met its own surface, a little before the object's, and weighs images by how squarely they saw it. So
 * images say little of surfaces along their view, between samples before and behind, unless no other sees them; for the
 * colours of such the surface is met more closely.
 *
 * matrices: (VIEWS, 16) from the world to each view's pixel space. sizes: (VIEWS, 3) width, height and start in maps
 * and colors. maps: nearness, or 0 and 1. colors: RGBA bytes, A = 255 where the view has a sample. order: (VIEWS,)
 * views in the order of testing. closeness: (VIEWS,) of each view's direction to the target's, > 0. world: its origin
 * is the box's middle. box: world to the box's frame, where it is the unit cube. edges: of the box. counts: (height,
 * width) view tests, with COUNTERS. With RIBBONS, firsts: the number of the first ribbon of each sample of each view, and at
 * last that of all; ribbons: (N, RIBBON_FLOATS), ribbon.h.
 * Work-item: with LANES 16 a block of 4 x 4 pixels, one to a lane; with LANES 1 a pixel. Cost: O(pixels * slices * views
 * tested). Determinism: fixed order.
 */
#define BIN BLOCK
#include "lib/color.h"
#include "lib/taps.h"
#include "raster/region.h"
#include "slicing/rays.h"
#include "slicing/ribbon_record.h"

#ifndef VIEWS
#define VIEWS 6 /* of the object */
#endif
#ifndef SILHOUETTES
#define SILHOUETTES 0 /* 1: maps are masks */
#endif
#ifndef RIBBONS
#define RIBBONS 0 /* 1: what is one sample thin in a view is as wide there as its ribbons (slicing/ribbons.cl) */
#endif
#define TO_SCREEN 3 /* the axis of slices that are parallel to the screen; others are 0, 1, 2 */
#define BLENDED_VIEWS 3 /* views that a colour is made of at most */
#define LEVEL_SAMPLES 0.5f /* samples by which one of a view lies off a point for it to count half of how well the view sees it, */
#define TORN_SAMPLES 4.0f  /* and of the view's colour there */
#define HIDDEN_SAMPLES 4.0f /* samples by which all those around a point may lie before it */
#define VIEWS_MIN 0.002f /* of a view: where all together see less, the surface is met more closely for its colour */
#define CLOSER_HALVINGS 6     /* further halvings there: along a view a surface moves by its whole length within a sample */
#define STRIDES 4    /* of the way back from the object's surface to a view's own, each as long as those before it */

typedef struct {
    float from_world[12]; /* row by row */
    float edges[3];       /* of the box, in scene units */
    float spacing;        /* of the slices, in scene units */
    float first;          /* number of a slice parallel to the screen that is counted as 0: one through the middle */
    int slices;           /* along the longest edge */
    int alone;            /* 1: slice number `only` is drawn, and no other */
    int only;
} Box;

typedef struct {
    Linear x, y, z;
} WorldRay;

/* One row of a matrix, of a ray's points (homogeneous coordinate 1) */
Linear row_of(global const float *m, const WorldRay *ray)
{
    Linear made;
    made.fixed = m[0] * ray->x.fixed + m[1] * ray->y.fixed + m[2] * ray->z.fixed + m[3];
    made.sloped = m[0] * ray->x.sloped + m[1] * ray->y.sloped + m[2] * ray->z.sloped;
    return made;
}

/* What a view's image has around a place: four samples, their weights, and whether the place is on the image */
typedef struct {
    Taps taps;
    floatl weights[4];
    intl on_image;
} Samples;

INLINED Samples samples_at(global const int *size, floatl x, floatl y)
{
    Samples samples;
    samples.taps = clamped_taps(size[0], size[1], x, y);
    tap_weights(samples.taps.fx, samples.taps.fy, samples.weights);
    samples.on_image = (x >= -0.5f) & (x <= size[0] - 0.5f) & (y >= -0.5f) & (y <= size[1] - 0.5f);
    return samples;
}

INLINED floatl read_map(global const float *map, Samples samples)
{
    floatl sum = 0.0f;
    for (int k = 0; k < 4; k++)
        sum += samples.weights[k] * (floatl)(gather(map, samples.taps.at[k]));
    return sum;
}

/* A view's pixel space along the rays */
typedef struct {
    Linear u, v, w, q;
} ViewRay;

ViewRay view_ray(global const float *matrix, const WorldRay *ray)
{
    const ViewRay made = {row_of(matrix, ray), row_of(matrix + 4, ray), row_of(matrix + 8, ray), row_of(matrix + 12, ray)};
    return made;
}

typedef struct {
    global const float *matrices;
    global const int *sizes;
    global const float *maps;
    global const uint *colors;
    global const int *order;
    global const float *closeness;
    int visible, unknown;
    float sample, stride;
#if RIBBONS
    global const int *firsts;
    global const float *ribbons;
#endif
    global const uint *normals; /* RGBA bytes, as colors; with GBUFFER 2 */
} Views;

#if RIBBONS
/* The map's value at (x, y) of a view, or that of the nearest of its ribbons there, if it is nearer */
INLINED floatl over_ribbons(const Views *views, global const int *size, floatl x, floatl y, intl active, floatl value)
{
    const floatl column = clamp_lanes(floor_lanes(x + 0.5f), (floatl)0.0f, (floatl)(size[0] - 1));
    const floatl row = clamp_lanes(floor_lanes(y + 0.5f), (floatl)0.0f, (floatl)(size[1] - 1));
    const intl at = size[2] + to_intl(row) * size[0] + to_intl(column), next = at + 1;
    intl number = (intl)(gather(views->firsts, at));
    const intl last = (intl)(gather(views->firsts, next));
    for (; any_lane(active & (number < last)); number++) {
        const intl there = active & (number < last), first = RIBBON_FLOATS * pick(there, number, (intl)0);
        floatl part[RIBBON_FLOATS];
        for (int k = 0; k < RIBBON_FLOATS; k++) {
            const intl here = first + k;
            part[k] = (floatl)(gather(views->ribbons, here));
        }
        floatl low = 0.0f, high = 1.0f;
        const floatl across[2] = {x - part[0], y - part[1]};
        for (int axis = 0; axis < 2; axis++) { /* of the way, where the square holds the point */
            const floatl way = part[2 + axis], per_way = 1.0f / pick(fabs(way) > 1e-6f, way, (floatl)1e-6f);
            const floatl a = (across[axis] - 0.5f) * per_way, b = (across[axis] + 0.5f) * per_way;
            low = max_lanes(low, min_lanes(a, b));
            high = min_lanes(high, max_lanes(a, b));
        }
        const floatl along = across[0] * part[2] + across[1] * part[3];
        const intl beyond = (part[7] > 0.5f) & (along > part[2] * part[2] + part[3] * part[3]);
        const floatl near = part[4] + part[5] * across[0] + part[6] * across[1];
        value = pick(there & (low <= high) & !beyond, max_lanes(value, near), value);
    }
    return value;
}
#endif

/* Which of the points at z pass the test of every view? passed: gains how many views let them, until one does not */
intl inside_all(const Views *views, const ViewRay *rays, floatl z, intl inside, intl *passed, intl *tests)
{
    for (int i = 0; i < VIEWS && any_lane(inside); i++) {
        *tests += inside & 1;
        const floatl w = AT(rays[i].w, z), inverse = 1.0f / w;
        global const int *size = views->sizes + 3 * views->order[i];
        const floatl u = AT(rays[i].u, z) * inverse, v = AT(rays[i].v, z) * inverse;
        const Samples samples = samples_at(size, u, v);
        floatl value = read_map(views->maps + size[2], samples);
#if RIBBONS
        value = over_ribbons(views, size, u, v, inside & samples.on_image, value);
#endif
#if SILHOUETTES
        inside = inside & samples.on_image & (w > 0.0f) & (value >= 0.5f);
#else
        const intl seen = samples.on_image & (w > 0.0f);
        inside = inside & (seen | (intl)(views->unknown ? -1 : 0)) & (!seen | (AT(rays[i].q, z) * inverse <= value));
#endif
        *passed -= inside;
    }
    return inside;
}

/* The rays of the pixels (x, y): perspective ones start at the centre, orthographic ones run along it. */
WorldRay world_ray(Screen screen, floatl x, floatl y)
{
    const float *m = screen.to_world;
    const floatl across[3] = {PIXEL_ROW(m, 0, x, y), PIXEL_ROW(m, 1, x, y), PIXEL_ROW(m, 2, x, y)};
    Linear axis[3];
    for (int k = 0; k < 3; k++) {
        axis[k].fixed = screen.perspective ? (floatl)m[4 * k + 3] : across[k];
        axis[k].sloped = screen.perspective ? across[k] : (floatl)(-m[4 * k + 3]);
    }
    const WorldRay ray = {axis[0], axis[1], axis[2]};
    return ray;
}

/* Of a ray, from front to back, what is in the box; the slices are where the number is a whole one. */
typedef struct {
    floatl front, back;
    Linear number;
    int most; /* no number in the box is beyond that, nor below its opposite */
    int alone, only; /* of Box */
} RaySegment;

/* from: where the picture begins; slices_axis: of the box, 3: the slices are parallel to the screen */
RaySegment segment_in_box(Box box, const WorldRay *ray, floatl from, int slices_axis)
{
    /* As many as lie along the longest edge, or fewer; and as many again for rounding: where it is off by more, no float
     * tells depths in the box apart. */
    RaySegment segment = {from, INFINITY, {-box.first, 1.0f / box.spacing}, 2 * (box.slices + 1), box.alone, box.only};
    for (int k = 0; k < 3; k++) {
        const float *r = box.from_world + 4 * k;
        const Linear side = {r[0] * ray->x.fixed + r[1] * ray->y.fixed + r[2] * ray->z.fixed + r[3],
                             r[0] * ray->x.sloped + r[1] * ray->y.sloped + r[2] * ray->z.sloped};
        const floatl sloped = pick(fabs(side.sloped) < 1e-20f, (floatl)1e-20f, side.sloped);
        const floatl at_0 = -side.fixed / sloped, at_1 = (1.0f - side.fixed) / sloped;
        segment.front = max_lanes(min_lanes(at_0, at_1), segment.front);
        segment.back = clamp_lanes(at_0, at_1, segment.back);
        if (k == slices_axis) {
            segment.number.fixed = side.fixed * (box.edges[k] / box.spacing);
            segment.number.sloped = sloped * (box.edges[k] / box.spacing);
        }
    }
    return segment;
}

/* Brings what passed back towards what did not, `way` before it, halving by halving. */
void refine_object_hit(const Views *views, const ViewRay *rays, RaySegment segment, floatl way, int halvings, intl found, floatl *hit, intl *tests)
{
    floatl before = max_lanes(*hit - way, segment.front);
    for (int i = 0; i < halvings && any_lane(found); i++) {
        const floatl middle = 0.5f * (before + *hit);
        intl passed = 0;
        const intl inside = inside_all(views, rays, middle, found, &passed, tests);
        *hit = pick(inside, middle, *hit);
        before = pick(inside, before, middle);
    }
}

/* Rays are kept out of the object by one view at the slice before z, and by another at z, where `passed` let them. Are
 * they in it where the one gives way to the other? Then a part of it is thinner than slices lie apart. Sets hit. */
intl intersect_between(const Views *views, const ViewRay *rays, RaySegment segment, floatl z, floatl way, int halvings, intl crossed,
                  intl passed, floatl *hit, intl *tests)
{
    floatl before = max_lanes(z - way, segment.front), after = z;
    intl found = 0;
    for (int i = 0; i < halvings && any_lane(crossed & !found); i++) {
        const floatl middle = 0.5f * (before + after);
        intl here = 0;
        const intl inside = inside_all(views, rays, middle, crossed & !found, &here, tests);
        const intl behind = here == passed;
        *hit = pick(inside, middle, *hit);
        found = found | inside;
        after = pick(behind, middle, after);
        before = pick(behind, before, middle);
    }
    return found;
}

/* Where do rays meet the object before what is drawn, which hides it from `hidden` on? Sets hit there. */
intl intersect_object(const Views *views, const WorldRay *ray, RaySegment segment, floatl hidden, int halvings, int finds_thin,
                 floatl *hit, intl *tests)
{
    intl searches = segment.front <= segment.back, found = 0, last = -1;
    if (!any_lane(searches))
        return found;
    ViewRay rays[VIEWS];
    for (int i = 0; i < VIEWS; i++)
        rays[i] = view_ray(views->matrices + 16 * views->order[i], ray);
    const intl rises = segment.number.sloped > 0.0f;
    const floatl step = pick(rises, (floatl)1.0f, (floatl)-1.0f), per_slice = 1.0f / segment.number.sloped;
    const floatl most = segment.most, s_front = clamp_lanes(AT(segment.number, segment.front), -most, most);
    const floatl back = min_lanes(hidden + fabs(per_slice), segment.back); /* halvings bring a point forward by up to a slice */
    floatl slice = segment.alone ? (floatl)(float)segment.only : pick(rises, ceil_lanes(s_front), floor_lanes(s_front));
    for (int left = segment.alone ? 0 : 2 * segment.most; left >= 0; left--, slice += step) {
        const floatl z = (slice - segment.number.fixed) * per_slice;
        searches = searches & !found & (z <= back);
        if (!any_lane(searches))
            break;
        intl passed = 0;
        const intl active = searches & (z >= segment.front), inside = inside_all(views, rays, z, active, &passed, tests);
        *hit = pick(inside, z, *hit);
        found = found | inside;
        const intl crossed = active & !inside & (passed != last);
        if (finds_thin && any_lane(crossed))
            found = found | intersect_between(views, rays, segment, z, fabs(per_slice), halvings, crossed, passed, hit, tests);
        last = pick(active, passed, last);
    }
    refine_object_hit(views, rays, segment, fabs(per_slice), halvings, found, hit, tests);
    return found;
}

/* Colours of at most BLENDED_VIEWS views, by how close they are */
typedef struct {
    Color color, normal;
    floatl weight;
    floatl views; /* which a part of counts as that part */
} Blend;

/* How many samples (of the coarsest view) a difference of a view's nearness is long, where that is `mine` */
INLINED floatl samples_per_nearness(const Views *views, const ViewRay *view, floatl mine)
{
    const intl flat = fabs(view->w.fixed - 1.0f) + fabs(view->w.sloped) == 0.0f; /* orthographic: nearness is -z */
    return 1.0f / (views->sample * pick(flat, (floatl)1.0f, mine * mine));
}

/* What a view's samples around a place say of points there: the colours of all, or of those about as far away. */
typedef struct {
    Color color, normal; /* times their weights */
    floatl weight;
    floatl part; /* of them that are as far away as the point: of a surface that is seen aslant few are */
    intl sees;
} ViewColor;

INLINED ViewColor view_color(const Views *views, int number, const ViewRay *view, Samples samples, floatl at, int trusting)
{
    ViewColor seen_color = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f, samples.on_image};
    global const int *size = views->sizes + 3 * number;
    const floatl mine = AT(view->q, at) / AT(view->w, at), by = samples_per_nearness(views, view, mine);
    for (int k = 0; k < 4; k++) {
        const intl word = texels_at(views->colors + size[2], samples.taps.at[k]);
        floatl weight = samples.weights[k] * to_floatl((word >> 24) & 1);
        if (trusting) {
            const floatl off = ((floatl)(gather(views->maps + size[2], samples.taps.at[k])) - mine) * by, squared = off * off;
            seen_color.part += weight / (1.0f + squared * (1.0f / (LEVEL_SAMPLES * LEVEL_SAMPLES)));
            weight = weight / (1.0f + squared * (1.0f / (TORN_SAMPLES * TORN_SAMPLES)));
        }
        add_color(&seen_color.color, weight, color_of(word));
#if GBUFFER == 2
        add_color(&seen_color.normal, weight, color_of(texels_at(views->normals + size[2], samples.taps.at[k])));
#endif
        seen_color.weight += weight;
    }
    seen_color.sees = seen_color.sees & (seen_color.weight > (trusting ? 0.0f : 1e-3f));
    return seen_color;
}

/* How much nearer than the rays' points at z a view's surface is, in samples; farthest: the farthest of those around */
INLINED floatl view_surface_before(const Views *views, int number, const ViewRay *view, floatl z, floatl *farthest)
{
    global const int *size = views->sizes + 3 * number;
    const floatl inverse = 1.0f / AT(view->w, z), mine = AT(view->q, z) * inverse;
    const Samples samples = samples_at(size, AT(view->u, z) * inverse, AT(view->v, z) * inverse);
    floatl sum = 0.0f, least = INFINITY;
    for (int k = 0; k < 4; k++) {
        const floatl there = (floatl)(gather(views->maps + size[2], samples.taps.at[k]));
        sum += samples.weights[k] * there;
        least = min_lanes(least, there);
    }
    const floatl per_sample = samples_per_nearness(views, view, mine);
    *farthest = (least - mine) * per_sample;
    return (sum - mine) * per_sample;
}

/* Where the rays met a view's own surface, up to STRIDES strides before the object's: that begins where the last of all
 * views' volumes does, and each loses up to a sample at its edges. Rays that did not meet it are left out of `asked`, and
 * points that lie far behind all of the view's samples around them. */
INLINED floatl own_surface_before(const Views *views, int number, const ViewRay *view, floatl hit, intl *active)
{
    floatl farthest, z = hit, from = hit, last = view_surface_before(views, number, view, hit, &farthest);
    *active = *active & (farthest <= HIDDEN_SAMPLES);
    intl open = *active & (last > 0.0f);
    float back = views->stride;
    for (int i = 0; i < STRIDES && any_lane(open); i++, back *= 2.0f) {
        const floatl to = hit - back, before = view_surface_before(views, number, view, to, &farthest);
        const intl met = open & (before <= 0.0f);
        z = pick(met, to + (to - from) * before / (last - before), z);
        open = open & !met;
        from = to;
        last = before;
    }
    *active = *active & !open;
    return z;
}

/* Blends colours of the rays' points at `hit`: trusting, of views that see them, else of the closest. */
Blend blend_views(const Views *views, const WorldRay *ray, floatl hit, intl active, int trusting)
{
    Blend blend = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
    for (int i = 0; i < VIEWS; i++) { /* `order` is from the closest on */
        intl wanted = active & (blend.views < BLENDED_VIEWS - 0.5f);
        if (!any_lane(wanted))
            break;
        const int number = views->order[i];
        global const int *size = views->sizes + 3 * number;
        const ViewRay view = view_ray(views->matrices + 16 * number, ray);
        const floatl at = trusting ? own_surface_before(views, number, &view, hit, &wanted) : hit, inverse = 1.0f / AT(view.w, at);
        const Samples samples = samples_at(size, AT(view.u, at) * inverse, AT(view.v, at) * inverse);
        const ViewColor seen_color = view_color(views, number, &view, samples, at, trusting);
        const floatl part = trusting ? seen_color.part : (floatl)1.0f; /* samples without colours take nothing from others */
        const floatl share = pick(wanted & seen_color.sees, views->closeness[number] * part / seen_color.weight, (floatl)0.0f);
        const Color none = {0.0f, 0.0f, 0.0f};
        add_color(&blend.color, share, pick_color(seen_color.sees, seen_color.color, none));
#if GBUFFER == 2
        add_color(&blend.normal, share, pick_color(seen_color.sees, seen_color.normal, none));
#endif
        blend.weight += share * pick(seen_color.sees, seen_color.weight, (floatl)0.0f);
        blend.views += pick(wanted & seen_color.sees, part, (floatl)0.0f);
    }
    return blend;
}

/* Of the rays' points at `hit`: of views that see them, if there are, else of any */
Blend blend_at(const Views *views, const WorldRay *ray, RaySegment segment, floatl hit, int halvings, intl found, intl *tests)
{
    Blend blend = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
    if (!SILHOUETTES && views->visible) {
        blend = blend_views(views, ray, hit, found, 1);
        const intl doubted = found & (blend.views < VIEWS_MIN);
        if (any_lane(doubted)) {
            ViewRay rays[VIEWS];
            for (int i = 0; i < VIEWS; i++)
                rays[i] = view_ray(views->matrices + 16 * views->order[i], ray);
            const floatl way = fabs(1.0f / segment.number.sloped) / (float)(1 << halvings);
            refine_object_hit(views, rays, segment, way, CLOSER_HALVINGS, doubted, &hit, tests);
            const Blend closer = blend_views(views, ray, hit, doubted, 1);
            blend.color = pick_color(doubted, closer.color, blend.color);
            blend.normal = pick_color(doubted, closer.normal, blend.normal);
            blend.weight = pick(doubted, closer.weight, blend.weight);
        }
    }
    const intl unseen = found & !(blend.weight > 0.0f);
    if (any_lane(unseen)) {
        const Blend any = blend_views(views, ray, hit, unseen, 0);
        blend.color = pick_color(unseen, any.color, blend.color);
        blend.normal = pick_color(unseen, any.normal, blend.normal);
        blend.weight = pick(unseen, any.weight, blend.weight);
    }
    return blend;
}

kernel void draw_object(global const float *matrices, global const int *sizes, global const float *maps,
                        global const uint *colors, global const int *order, global const float *closeness,
                        global float *depth, global channel *color, global uchar *valid, Screen screen, Box box,
                        int slices_axis,
                        int halvings /* of the way back to the slice before, once one has passed */,
                        int finds_thin /* 1: what is thinner than slices lie apart, too */, int visible,
                        int unknown /* 1: images say nothing of what lies beside them */,
                        float sample /* scene units between samples in the middle of the box, of the coarsest view */,
                        float stride /* of the ray, from the object's surface back to a view's own */,
                        int low_x, int low_y, int blank COUNTERS_PARAMETER(int)
#if RIBBONS
                        ,
                        global const int *firsts /* of the ribbons of each view's samples, and the end of all */,
                        global const float *ribbons
#endif
                        GBUFFER_PARAMETERS NORMALS_PARAMETER(uint))
{
    const int x = low_x + get_global_id(0) * BLOCK, y = low_y + get_global_id(1) * BLOCK;
    if (x >= screen.width || y >= screen.height)
        return;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);

    const Views views = {matrices, sizes, maps, colors, order, closeness, visible, unknown, sample, stride,
#if RIBBONS
                         firsts, ribbons,
#endif
                         NORMALS_ARGUMENT(uint),
    };
    const WorldRay ray = world_ray(screen, to_floatl(x + block_x), to_floatl(y + block_y));
    const floatl so_far = region.nearness[0];
    const floatl hidden = pick(so_far <= EMPTY, (floatl)INFINITY, DEPTH_OF(screen.perspective, so_far));
    const RaySegment segment = segment_in_box(box, &ray, screen.perspective ? 1.0f / screen.nearest : 0.0f, slices_axis);
    floatl hit = 0.0f;
    intl tests = 0, found = intersect_object(&views, &ray, segment, hidden, halvings, finds_thin, &hit, &tests);
    const floatl nearness = DEPTH_OF(screen.perspective, hit);
    found = found & (nearness > so_far); /* of what is equally far, the first stays */
    region.nearness[0] = pick(found, nearness, so_far);
    region.owner[0] = pick(found, (intl)0, (intl)-1);
    Color shade = {0.0f, 0.0f, 0.0f}, normal = shade;
    if (any_lane(found)) {
        const Blend blend = blend_at(&views, &ray, segment, hit, halvings, found, &tests);
        const floatl scale = 1.0f / (255.0f * fmax(blend.weight, (floatl)1e-20f));
        shade = color_times(blend.color, scale);
        normal = color_times(blend.normal, scale);
    }
    if (COUNTERS)
        add_to_counters(COUNTERS_ARGUMENT(int), screen, x, y, tests);
    const intl written = write_block(&region, 0, screen, depth, color, valid, blank, x, y, shade);
    const GBuffer gbuffer = GBUFFER_VALUE;
    enter_block(gbuffer, written, screen, depth, x, y, normal);
}
