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
 * width) view tests, with COUNTED. With THIN, firsts: the number of the first ribbon of each sample of each view, and at
 * last that of all; ribbons: (N, RIBBON), ribbon.h.
 * Work-item: with LANES 16 a block of 4 x 4 pixels, one to a lane; with LANES 1 a pixel. Cost: O(pixels * slices * views
 * tested). Determinism: fixed order.
 */
#define BIN BLOCK
#include "lib/color.h"
#include "lib/taps.h"
#include "raster/region.h"
#include "slicing/rays.h"
#include "slicing/ribbon.h"

#ifndef VIEWS
#define VIEWS 6 /* of the object */
#endif
#ifndef SILHOUETTES
#define SILHOUETTES 0 /* 1: maps are masks */
#endif
#ifndef THIN
#define THIN 0 /* 1: what is one sample thin in a view is as wide there as its ribbons (slicing/ribbons.cl) */
#endif
#define TO_SCREEN 3 /* the axis of slices that are parallel to the screen; others are 0, 1, 2 */
#define BLENDED 3 /* views that a colour is made of at most */
#define LEVEL 0.5f /* samples by which one of a view lies off a point for it to count half of how well the view sees it, */
#define TORN 4.0f  /* and of the view's colour there */
#define HIDDEN 4.0f /* samples by which all those around a point may lie before it */
#define DOUBTED 0.002f /* of a view: where all together see less, the surface is met more closely for its colour */
#define CLOSER 6     /* further halvings there: along a view a surface moves by its whole length within a sample */
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
#if THIN
    global const int *firsts;
    global const float *ribbons;
#endif
} Views;

#if THIN
/* The map's value at (x, y) of a view, or that of the nearest of its ribbons there, if it is nearer */
INLINED floatl over_ribbons(const Views *views, global const int *size, floatl x, floatl y, intl asked, floatl value)
{
    const floatl column = lesser(greater(floor_lanes(x + 0.5f), (floatl)0.0f), (floatl)(size[0] - 1));
    const floatl row = lesser(greater(floor_lanes(y + 0.5f), (floatl)0.0f), (floatl)(size[1] - 1));
    const intl at = size[2] + to_intl(row) * size[0] + to_intl(column), next = at + 1;
    intl number = (intl)(gather(views->firsts, at));
    const intl last = (intl)(gather(views->firsts, next));
    for (; any_lane(asked & (number < last)); number++) {
        const intl there = asked & (number < last), first = RIBBON * pick(there, number, (intl)0);
        floatl part[RIBBON];
        for (int k = 0; k < RIBBON; k++) {
            const intl here = first + k;
            part[k] = (floatl)(gather(views->ribbons, here));
        }
        floatl low = 0.0f, high = 1.0f;
        const floatl across[2] = {x - part[0], y - part[1]};
        for (int axis = 0; axis < 2; axis++) { /* of the way, where the square holds the point */
            const floatl way = part[2 + axis], per_way = 1.0f / pick(fabs(way) > 1e-6f, way, (floatl)1e-6f);
            const floatl a = (across[axis] - 0.5f) * per_way, b = (across[axis] + 0.5f) * per_way;
            low = greater(low, lesser(a, b));
            high = lesser(high, greater(a, b));
        }
        const floatl along = across[0] * part[2] + across[1] * part[3];
        const intl beyond = (part[7] > 0.5f) & (along > part[2] * part[2] + part[3] * part[3]);
        const floatl near = part[4] + part[5] * across[0] + part[6] * across[1];
        value = pick(there & (low <= high) & !beyond, greater(value, near), value);
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
#if THIN
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
} Part;

/* from: where the picture begins; slices_axis: of the box, 3: the slices are parallel to the screen */
Part part_in(Box box, const WorldRay *ray, floatl from, int slices_axis)
{
    /* As many as lie along the longest edge, or fewer; and as many again for rounding: where it is off by more, no float
     * tells depths in the box apart. */
    Part part = {from, INFINITY, {-box.first, 1.0f / box.spacing}, 2 * (box.slices + 1), box.alone, box.only};
    for (int k = 0; k < 3; k++) {
        const float *r = box.from_world + 4 * k;
        const Linear side = {r[0] * ray->x.fixed + r[1] * ray->y.fixed + r[2] * ray->z.fixed + r[3],
                             r[0] * ray->x.sloped + r[1] * ray->y.sloped + r[2] * ray->z.sloped};
        const floatl sloped = pick(fabs(side.sloped) < 1e-20f, (floatl)1e-20f, side.sloped);
        const floatl at_0 = -side.fixed / sloped, at_1 = (1.0f - side.fixed) / sloped;
        part.front = greater(lesser(at_0, at_1), part.front);
        part.back = lesser(greater(at_0, at_1), part.back);
        if (k == slices_axis) {
            part.number.fixed = side.fixed * (box.edges[k] / box.spacing);
            part.number.sloped = sloped * (box.edges[k] / box.spacing);
        }
    }
    return part;
}

/* Brings what passed back towards what did not, `way` before it, halving by halving. */
void halve(const Views *views, const ViewRay *rays, Part part, floatl way, int halvings, intl found, floatl *hit, intl *tests)
{
    floatl before = greater(*hit - way, part.front);
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
intl meet_between(const Views *views, const ViewRay *rays, Part part, floatl z, floatl way, int halvings, intl crossed,
                  intl passed, floatl *hit, intl *tests)
{
    floatl before = greater(z - way, part.front), after = z;
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
intl meet_object(const Views *views, const WorldRay *ray, Part part, floatl hidden, int halvings, int seeks,
                 floatl *hit, intl *tests)
{
    intl searches = part.front <= part.back, found = 0, last = -1;
    if (!any_lane(searches))
        return found;
    ViewRay rays[VIEWS];
    for (int i = 0; i < VIEWS; i++)
        rays[i] = view_ray(views->matrices + 16 * views->order[i], ray);
    const intl rises = part.number.sloped > 0.0f;
    const floatl step = pick(rises, (floatl)1.0f, (floatl)-1.0f), per_slice = 1.0f / part.number.sloped;
    const floatl most = part.most, s_front = lesser(greater(AT(part.number, part.front), -most), most);
    const floatl back = lesser(hidden + fabs(per_slice), part.back); /* halvings bring a point forward by up to a slice */
    floatl slice = part.alone ? (floatl)(float)part.only : pick(rises, ceil_lanes(s_front), floor_lanes(s_front));
    for (int left = part.alone ? 0 : 2 * part.most; left >= 0; left--, slice += step) {
        const floatl z = (slice - part.number.fixed) * per_slice;
        searches = searches & !found & (z <= back);
        if (!any_lane(searches))
            break;
        intl passed = 0;
        const intl asked = searches & (z >= part.front), inside = inside_all(views, rays, z, asked, &passed, tests);
        *hit = pick(inside, z, *hit);
        found = found | inside;
        const intl crossed = asked & !inside & (passed != last);
        if (seeks && any_lane(crossed))
            found = found | meet_between(views, rays, part, z, fabs(per_slice), halvings, crossed, passed, hit, tests);
        last = pick(asked, passed, last);
    }
    halve(views, rays, part, fabs(per_slice), halvings, found, hit, tests);
    return found;
}

/* Colours of at most BLENDED views, by how close they are */
typedef struct {
    Color color;
    floatl weight;
    floatl views; /* which a part of counts as that part */
} Blend;

INLINED Color color_times(Color c, floatl by)
{
    const Color made = {by * c.r, by * c.g, by * c.b};
    return made;
}

/* How many samples (of the coarsest view) a difference of a view's nearness is long, where that is `mine` */
INLINED floatl samples_per_nearness(const Views *views, const ViewRay *view, floatl mine)
{
    const intl flat = fabs(view->w.fixed - 1.0f) + fabs(view->w.sloped) == 0.0f; /* orthographic: nearness is -z */
    return 1.0f / (views->sample * pick(flat, (floatl)1.0f, mine * mine));
}

/* What a view's samples around a place say of points there: the colours of all, or of those about as far away. */
typedef struct {
    Color color; /* times their weights */
    floatl weight;
    floatl part; /* of them that are as far away as the point: of a surface that is seen aslant few are */
    intl sees;
} Told;

INLINED Told told_by(const Views *views, int number, const ViewRay *view, Samples samples, floatl at, int trusting)
{
    Told told = {{0.0f, 0.0f, 0.0f}, 0.0f, 0.0f, samples.on_image};
    global const int *size = views->sizes + 3 * number;
    const floatl mine = AT(view->q, at) / AT(view->w, at), by = samples_per_nearness(views, view, mine);
    for (int k = 0; k < 4; k++) {
        const intl word = texels_at(views->colors + size[2], samples.taps.at[k]);
        floatl weight = samples.weights[k] * to_floatl((word >> 24) & 1);
        if (trusting) {
            const floatl off = ((floatl)(gather(views->maps + size[2], samples.taps.at[k])) - mine) * by, squared = off * off;
            told.part += weight / (1.0f + squared * (1.0f / (LEVEL * LEVEL)));
            weight = weight / (1.0f + squared * (1.0f / (TORN * TORN)));
        }
        add_color(&told.color, weight, color_of(word));
        told.weight += weight;
    }
    told.sees = told.sees & (told.weight > (trusting ? 0.0f : 1e-3f));
    return told;
}

/* How much nearer than the rays' points at z a view's surface is, in samples; farthest: the farthest of those around */
INLINED floatl before_at(const Views *views, int number, const ViewRay *view, floatl z, floatl *farthest)
{
    global const int *size = views->sizes + 3 * number;
    const floatl inverse = 1.0f / AT(view->w, z), mine = AT(view->q, z) * inverse;
    const Samples samples = samples_at(size, AT(view->u, z) * inverse, AT(view->v, z) * inverse);
    floatl sum = 0.0f, least = INFINITY;
    for (int k = 0; k < 4; k++) {
        const floatl there = (floatl)(gather(views->maps + size[2], samples.taps.at[k]));
        sum += samples.weights[k] * there;
        least = lesser(least, there);
    }
    const floatl per_sample = samples_per_nearness(views, view, mine);
    *farthest = (least - mine) * per_sample;
    return (sum - mine) * per_sample;
}

/* Where the rays met a view's own surface, up to STRIDES strides before the object's: that begins where the last of all
 * views' volumes does, and each loses up to a sample at its edges. Rays that did not meet it are left out of `asked`, and
 * points that lie far behind all of the view's samples around them. */
INLINED floatl met_before(const Views *views, int number, const ViewRay *view, floatl hit, intl *asked)
{
    floatl farthest, z = hit, from = hit, last = before_at(views, number, view, hit, &farthest);
    *asked = *asked & (farthest <= HIDDEN);
    intl open = *asked & (last > 0.0f);
    float back = views->stride;
    for (int i = 0; i < STRIDES && any_lane(open); i++, back *= 2.0f) {
        const floatl to = hit - back, before = before_at(views, number, view, to, &farthest);
        const intl met = open & (before <= 0.0f);
        z = pick(met, to + (to - from) * before / (last - before), z);
        open = open & !met;
        from = to;
        last = before;
    }
    *asked = *asked & !open;
    return z;
}

/* Blends colours of the rays' points at `hit`: trusting, of views that see them, else of the closest. */
Blend blend_views(const Views *views, const WorldRay *ray, floatl hit, intl asked, int trusting)
{
    Blend blend = {{0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
    for (int i = 0; i < VIEWS; i++) { /* `order` is from the closest on */
        intl wanted = asked & (blend.views < BLENDED - 0.5f);
        if (!any_lane(wanted))
            break;
        const int number = views->order[i];
        global const int *size = views->sizes + 3 * number;
        const ViewRay view = view_ray(views->matrices + 16 * number, ray);
        const floatl at = trusting ? met_before(views, number, &view, hit, &wanted) : hit, inverse = 1.0f / AT(view.w, at);
        const Samples samples = samples_at(size, AT(view.u, at) * inverse, AT(view.v, at) * inverse);
        const Told told = told_by(views, number, &view, samples, at, trusting);
        const floatl part = trusting ? told.part : (floatl)1.0f; /* samples without colours take nothing from others */
        const floatl share = pick(wanted & told.sees, views->closeness[number] * part / told.weight, (floatl)0.0f);
        const Color none = {0.0f, 0.0f, 0.0f};
        add_color(&blend.color, share, pick_color(told.sees, told.color, none));
        blend.weight += share * pick(told.sees, told.weight, (floatl)0.0f);
        blend.views += pick(wanted & told.sees, part, (floatl)0.0f);
    }
    return blend;
}

/* Of the rays' points at `hit`: of views that see them, if there are, else of any */
Color color_at(const Views *views, const WorldRay *ray, Part part, floatl hit, int halvings, intl found, intl *tests)
{
    Blend blend = {{0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
    if (!SILHOUETTES && views->visible) {
        blend = blend_views(views, ray, hit, found, 1);
        const intl doubted = found & (blend.views < DOUBTED);
        if (any_lane(doubted)) {
            ViewRay rays[VIEWS];
            for (int i = 0; i < VIEWS; i++)
                rays[i] = view_ray(views->matrices + 16 * views->order[i], ray);
            const floatl way = fabs(1.0f / part.number.sloped) / (float)(1 << halvings);
            halve(views, rays, part, way, CLOSER, doubted, &hit, tests);
            const Blend closer = blend_views(views, ray, hit, doubted, 1);
            blend.color = pick_color(doubted, closer.color, blend.color);
            blend.weight = pick(doubted, closer.weight, blend.weight);
        }
    }
    const intl unseen = found & !(blend.weight > 0.0f);
    if (any_lane(unseen)) {
        const Blend any = blend_views(views, ray, hit, unseen, 0);
        blend.color = pick_color(unseen, any.color, blend.color);
        blend.weight = pick(unseen, any.weight, blend.weight);
    }
    return color_times(blend.color, 1.0f / (255.0f * fmax(blend.weight, (floatl)1e-20f)));
}

kernel void draw_object(global const float *matrices, global const int *sizes, global const float *maps,
                        global const uint *colors, global const int *order, global const float *closeness,
                        global float *depth, global channel *color, global uchar *valid, Screen screen, Box box,
                        int slices_axis,
                        int halvings /* of the way back to the slice before, once one has passed */,
                        int seeks /* 1: what is thinner than slices lie apart, too */, int visible,
                        int unknown /* 1: images say nothing of what lies beside them */,
                        float sample /* scene units between samples in the middle of the box, of the coarsest view */,
                        float stride /* of the ray, from the object's surface back to a view's own */,
                        int low_x, int low_y, int blank COUNTS_PARAMETER(int)
#if THIN
                        ,
                        global const int *firsts /* of the ribbons of each view's samples, and the end of all */,
                        global const float *ribbons
#endif
)
{
    const int x = low_x + get_global_id(0) * BLOCK, y = low_y + get_global_id(1) * BLOCK;
    if (x >= screen.width || y >= screen.height)
        return;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);

    const Views views = {matrices, sizes, maps, colors, order, closeness, visible, unknown, sample, stride,
#if THIN
                         firsts, ribbons,
#endif
    };
    const WorldRay ray = world_ray(screen, to_floatl(x + block_x), to_floatl(y + block_y));
    const floatl so_far = region.nearness[0];
    const floatl hidden = pick(so_far <= EMPTY, (floatl)INFINITY, DEPTH_OF(screen.perspective, so_far));
    const Part part = part_in(box, &ray, screen.perspective ? 1.0f / screen.nearest : 0.0f, slices_axis);
    floatl hit = 0.0f;
    intl tests = 0, found = meet_object(&views, &ray, part, hidden, halvings, seeks, &hit, &tests);
    const floatl nearness = DEPTH_OF(screen.perspective, hit);
    found = found & (nearness > so_far); /* of what is equally far, the first stays */
    region.nearness[0] = pick(found, nearness, so_far);
    region.owner[0] = pick(found, (intl)0, (intl)-1);
    Color shade = {0.0f, 0.0f, 0.0f};
    if (any_lane(found))
        shade = color_at(&views, &ray, part, hit, halvings, found, &tests);
    if (COUNTED)
        add_counts(COUNTS(int), screen, x, y, tests);
    write_block(&region, 0, screen, depth, color, valid, blank, x, y, shade);
}
