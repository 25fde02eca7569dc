/* Objects from images: the intersection of what each image leaves of space, by slices (Kautz & Seidel 2001,
 * sections 4 and 5).
 *
 * A pixel walks the slices of its ray's part of the object's box from front to back and stops at the first point that
 * passes the test of every view: behind the surface that the view's depth image displaces (SILHOUETTES 0), or inside
 * its silhouette (SILHOUETTES 1). A view's surface is bilinear in nearness; what it saw as background is as far as
 * FARTHEST.
 *
 * Deviations from the paper: the slices are met per pixel instead of drawn as polygons, so the stencil passes become
 * one loop; `halvings` brings the point that passes closer to the surface than its slice; `visible` weighs only images
 * that saw the point.
 *
 * matrices: (VIEWS, 16) from the world to each view's pixel space. sizes: (VIEWS, 3) width, height and start in maps
 * and colors. maps: nearness, or 0 and 1. colors: RGBA bytes, A = 255 where the view has a sample. order: (VIEWS,)
 * views in the order of testing. closeness: (VIEWS,) of each view's direction to the target's, > 0. world: its origin
 * is the box's middle. box: world to the box's frame, where it is the unit cube. edges: of the box. counts: (height, width) view tests, with COUNTED.
 * Work-item: with LANES 16 a block of 4 x 4 pixels, one to a lane; with LANES 1 a pixel. Cost: O(pixels * slices * views tested). Determinism: fixed order.
 */
#define BIN BLOCK
#include "lib/color.h"
#include "raster/region.h"

#ifndef VIEWS
#define VIEWS 6
#endif
#ifndef SILHOUETTES
#define SILHOUETTES 0 /* 1: maps are masks */
#endif
#define TO_SCREEN 3 /* the axis of slices that are parallel to the screen; others are 0, 1, 2 */
#define BLENDED 3 /* views that a colour is made of at most */

typedef struct {
    float from_world[12]; /* row by row */
    float edges[3];       /* of the box, in scene units */
    float spacing;        /* of the slices, in scene units */
    float first;          /* number of a slice parallel to the screen that is counted as 0: one near the box */
} Box;

/* base + z direction */
typedef struct {
    floatl base, direction;
} Line;

#define AT(line, z) ((line).base + (line).direction * (z))

typedef struct {
    Line x, y, z;
} Ray;

/* One row of a matrix, of a ray's points (homogeneous coordinate 1) */
Line row_of(global const float *m, const Ray *ray)
{
    Line made;
    made.base = m[0] * ray->x.base + m[1] * ray->y.base + m[2] * ray->z.base + m[3];
    made.direction = m[0] * ray->x.direction + m[1] * ray->y.direction + m[2] * ray->z.direction;
    return made;
}

/* The four samples around (x, y): their places and weights, and whether (x, y) is on the image. */
typedef struct {
    intl at[4];
    floatl weight[4];
    intl on_image;
} Taps;

Taps taps_of(global const int *size, floatl x, floatl y)
{
    const int width = size[0], height = size[1];
    Taps taps;
    taps.on_image = (x >= -0.5f) & (x <= width - 0.5f) & (y >= -0.5f) & (y <= height - 0.5f);
    const floatl cx = lesser(greater(x, (floatl)0.0f), (floatl)(width - 1)), cy = lesser(greater(y, (floatl)0.0f), (floatl)(height - 1));
    const floatl x0 = lesser(truncated(cx), (floatl)max(width - 2, 0)), y0 = lesser(truncated(cy), (floatl)max(height - 2, 0));
    const floatl fx = cx - x0, fy = cy - y0;
    const int right = min(width - 1, 1), down = min(height - 1, 1) * width;
    taps.at[0] = size[2] + to_intl(y0) * width + to_intl(x0);
    taps.at[1] = taps.at[0] + right;
    taps.at[2] = taps.at[0] + down;
    taps.at[3] = taps.at[2] + right;
    taps.weight[0] = (1.0f - fx) * (1.0f - fy);
    taps.weight[1] = fx * (1.0f - fy);
    taps.weight[2] = (1.0f - fx) * fy;
    taps.weight[3] = fx * fy;
    return taps;
}

floatl read_map(global const float *maps, Taps taps)
{
    floatl sum = 0.0f;
    for (int k = 0; k < 4; k++) {
        const intl at = taps.at[k];
        sum += taps.weight[k] * (floatl)(gather(maps, at));
    }
    return sum;
}

/* A view's pixel space along the rays */
typedef struct {
    Line u, v, w, q;
} ViewLines;

ViewLines lines_of(global const float *matrix, const Ray *ray)
{
    const ViewLines made = {row_of(matrix, ray), row_of(matrix + 4, ray), row_of(matrix + 8, ray),
                            row_of(matrix + 12, ray)};
    return made;
}

/* Which of the points at z pass the test of every view? */
intl inside_all(const ViewLines *views, global const int *order, global const int *sizes, global const float *maps,
                floatl z, intl inside, int unknown, intl *tests)
{
    for (int i = 0; i < VIEWS && any_lane(inside); i++) {
        *tests += inside & 1;
        const floatl w = AT(views[i].w, z), inverse = 1.0f / w;
        const Taps taps = taps_of(sizes + 3 * order[i], AT(views[i].u, z) * inverse, AT(views[i].v, z) * inverse);
        const floatl value = read_map(maps, taps);
#if SILHOUETTES
        inside = inside & taps.on_image & (w > 0.0f) & (value >= 0.5f);
#else
        const intl seen = taps.on_image & (w > 0.0f);
        inside = inside & (seen | (intl)(unknown ? -1 : 0)) & (!seen | (AT(views[i].q, z) * inverse <= value));
#endif
    }
    return inside;
}

kernel void draw_object(global const float *matrices, global const int *sizes, global const float *maps,
                        global const uint *colors, global const int *order, global const float *closeness,
                        global float *depth, global channel *color, global uchar *valid, Screen screen, Box box,
                        int slices_axis,
                        int halvings /* of the way back to the slice before, once one has passed */, int visible,
                        int unknown /* 1: images say nothing of what lies beside them */,
                        float tolerance /* scene units that a sample may lie before a point that it shows */,
                        int low_x, int low_y, int blank
#ifdef COUNTED
                        ,
                        global int *counts
#endif
)
{
    const int x = low_x + get_global_id(0) * BLOCK, y = low_y + get_global_id(1) * BLOCK;
    if (x >= screen.width || y >= screen.height)
        return;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);

    /* The pixels' rays in the world: perspective ones start at the centre, orthographic ones run along it. */
    const floatl px = to_floatl(x + block_x), py = to_floatl(y + block_y);
    const float *m = screen.to_world;
    const floatl at_x = PIXEL_ROW(m, 0, px, py), at_y = PIXEL_ROW(m, 1, px, py), at_z = PIXEL_ROW(m, 2, px, py);
    Ray ray;
    if (screen.perspective) {
        const Line rx = {m[3], at_x}, ry = {m[7], at_y}, rz = {m[11], at_z};
        ray.x = rx, ray.y = ry, ray.z = rz;
    } else {
        const Line rx = {at_x, -m[3]}, ry = {at_y, -m[7]}, rz = {at_z, -m[11]};
        ray.x = rx, ray.y = ry, ray.z = rz;
    }

    const floatl so_far = region.nearness[0];
    floatl front = screen.perspective ? 1.0f / screen.nearest : 0.0f;
    const floatl hidden = pick(so_far <= EMPTY, (floatl)INFINITY, screen.perspective ? 1.0f / so_far : -so_far);
    floatl back = INFINITY;
    Line number = {-box.first, 1.0f / box.spacing};
    for (int k = 0; k < 3; k++) {
        const float *r = box.from_world + 4 * k;
        const Line side = {r[0] * ray.x.base + r[1] * ray.y.base + r[2] * ray.z.base + r[3],
                           r[0] * ray.x.direction + r[1] * ray.y.direction + r[2] * ray.z.direction};
        const floatl direction = pick(fabs(side.direction) < 1e-20f, (floatl)1e-20f, side.direction);
        const floatl at_0 = -side.base / direction, at_1 = (1.0f - side.base) / direction;
        front = greater(lesser(at_0, at_1), front);
        back = lesser(greater(at_0, at_1), back);
        if (k == slices_axis) {
            number.base = side.base * (box.edges[k] / box.spacing);
            number.direction = direction * (box.edges[k] / box.spacing);
        }
    }
    intl searches = front <= back;
    intl found = 0, tests = 0;
    floatl hit = 0.0f;
    if (any_lane(searches)) {
        ViewLines views[VIEWS];
        for (int i = 0; i < VIEWS; i++)
            views[i] = lines_of(matrices + 16 * order[i], &ray);
        const intl rises = number.direction > 0.0f;
        const floatl step = pick(rises, (floatl)1.0f, (floatl)-1.0f), per_slice = 1.0f / number.direction;
        /* Beyond, the next slice would be the same float. */
        const floatl s_front = lesser(greater(AT(number, front), (floatl)-8388608.0f), (floatl)8388608.0f);
        back = lesser(hidden + fabs(per_slice), back); /* halvings bring a point forward by up to a slice */
        for (floatl slice = pick(rises, ceil_lanes(s_front), floor_lanes(s_front));; slice += step) {
            const floatl z = (slice - number.base) * per_slice;
            searches = searches & !found & (z <= back);
            if (!any_lane(searches))
                break;
            const intl inside = inside_all(views, order, sizes, maps, z, searches & (z >= front), unknown, &tests);
            hit = pick(inside, z, hit);
            found = found | inside;
        }
        floatl before = greater(hit - fabs(per_slice), front);
        for (int i = 0; i < halvings && any_lane(found); i++) {
            const floatl middle = 0.5f * (before + hit);
            const intl inside = inside_all(views, order, sizes, maps, middle, found, unknown, &tests);
            hit = pick(inside, middle, hit);
            before = pick(inside, before, middle);
        }
    }
#ifdef COUNTED
    for (int lane = 0; lane < LANES; lane++)
        if (x + lane % BLOCK < screen.width && y + lane / BLOCK < screen.height)
            counts[(size_t)(y + lane / BLOCK) * screen.width + x + lane % BLOCK] += ((const int *)&tests)[lane];
#endif
    const floatl nearness = screen.perspective ? 1.0f / hit : -hit;
    found = found & (nearness > so_far); /* of what is equally far, the first stays */
    region.nearness[0] = pick(found, nearness, so_far);
    region.owner[0] = pick(found, (intl)0, (intl)-1);

    Color shade = {0.0f, 0.0f, 0.0f};
    if (any_lane(found)) {
        Color seen = {0.0f, 0.0f, 0.0f}, any = {0.0f, 0.0f, 0.0f};
        floatl seen_weight = 0.0f, any_weight = 0.0f;
        intl seen_count = 0, any_count = 0;
        for (int i = 0; i < VIEWS; i++) { /* `order` is from the closest on */
            const intl wanted = found & (seen_count < BLENDED);
            if (!any_lane(wanted))
                break;
            const ViewLines view = lines_of(matrices + 16 * order[i], &ray);
            const floatl inverse = 1.0f / AT(view.w, hit);
            const Taps taps = taps_of(sizes + 3 * order[i], AT(view.u, hit) * inverse, AT(view.v, hit) * inverse);
            Color read = {0.0f, 0.0f, 0.0f};
            floatl opaque = 0.0f;
            for (int k = 0; k < 4; k++) {
                const intl at = taps.at[k];
                const intl word = as_intl((uintl)(gather(colors, at)));
                const floatl weight = taps.weight[k] * to_floatl((word >> 24) & 1);
                read.r += weight * to_floatl(word & 255);
                read.g += weight * to_floatl((word >> 8) & 255);
                read.b += weight * to_floatl((word >> 16) & 255);
                opaque += weight;
            }
            const intl has_color = taps.on_image & (opaque > 1e-3f);
            intl sees = has_color;
#if !SILHOUETTES
            const floatl mine = AT(view.q, hit) * inverse, theirs = read_map(maps, taps);
            const intl flat = fabs(AT(view.w, hit) - 1.0f) + fabs(view.w.direction) == 0.0f; /* orthographic: nearness is -z */
            sees = sees & (pick(flat, theirs - mine, (theirs - mine) / (theirs * mine)) <= tolerance);
#endif
            const floatl weight = closeness[order[i]] / (255.0f * opaque);
            const intl counts_any = has_color & (any_count < BLENDED);
            any.r += pick(counts_any, weight * read.r, (floatl)0.0f);
            any.g += pick(counts_any, weight * read.g, (floatl)0.0f);
            any.b += pick(counts_any, weight * read.b, (floatl)0.0f);
            any_weight += pick(counts_any, (floatl)closeness[order[i]], (floatl)0.0f);
            any_count += counts_any & 1;
            const intl counts_seen = sees & wanted;
            seen.r += pick(counts_seen, weight * read.r, (floatl)0.0f);
            seen.g += pick(counts_seen, weight * read.g, (floatl)0.0f);
            seen.b += pick(counts_seen, weight * read.b, (floatl)0.0f);
            seen_weight += pick(counts_seen, (floatl)closeness[order[i]], (floatl)0.0f);
            seen_count += counts_seen & 1;
        }
        const intl trusts = (seen_weight > 0.0f) & (visible ? (intl)-1 : (intl)0);
        const floatl scale = 1.0f / fmax(pick(trusts, seen_weight, any_weight), (floatl)1e-20f);
        shade.r = scale * pick(trusts, seen.r, any.r);
        shade.g = scale * pick(trusts, seen.g, any.g);
        shade.b = scale * pick(trusts, seen.b, any.b);
    }
    write_block(&region, 0, screen, depth, color, valid, blank, x, y, shade);
}
