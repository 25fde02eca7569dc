/* Depth meshes of several views, blended per pixel (Pajarola, Sainz & Meng 2003, sections 4.3 to 4.5).
 *
 * A region's pixels see each mesh's nearest surface first (the depth pass), then those of them that lie within epsilon
 * behind the front one give their colours (the colour pass), weighted and normalised at once. Where these leave a hole,
 * those of OTHERS do, coarser ones; and wherever a ray tells of surface that no view saw, that is closed (closing.h).
 * BLEND_QUALITY: weights of positions times quality, per pixel (the paper's); BLEND_POSITION: of positions alone;
 * BLEND_NEAREST: the front mesh's colour.
 *
 * Deviations from the paper: a mesh's own hidden surfaces are left out within epsilon, too; textures are projected, not
 * stretched over triangles, and read within the source's triangles, so that no colour leaks over a depth edge; what
 * bridges surfaces in coarse meshes is not drawn, but tells of surface.
 *
 * corners, projected, points: select.cl, mesh by mesh: SHEETS, BACKS, OTHERS, then those of VIEWS views. list, starts:
 * raster/bins.cl. firsts: (meshes + 1,) each mesh's first triangle. Of OTHERS and VIEWS: sources: (meshes, 4) number of its view, of the first
 * and the last of that view's levels, and 1 for a perspective view. levels: (levels, 3) width, height and start in colors,
 * each half as large as the one before, rounded up. scales: (meshes,) samples of the view to pixels of the target that a
 * scene unit takes at depth 1 of both. colors: RGBA bytes, A = 255 times the part that has samples. weights: (meshes,)
 * positional, > 0. culled: raster/triangle.h. If CLOSED, of ALL views there are: limits, behind, far_colors,
 * clear, open, limit_sizes, from_target, perspectives, first_levels, closeness and stride, closing.h. depth, color, valid: the picture,
 * which keeps what is nearer already. occupancy: (height, width) bit k is set where view k gave colour, with OCCUPIED.
 * Work-item: a region (raster/region.h). Cost: O(list + pixels * meshes). Determinism: list order, then the meshes'.
 */
#include "depthmesh/closing.h"
#include "lib/color.h"
#include "lib/taps.h"
#include "raster/nearest.h"

#ifndef VIEWS
#define VIEWS 1 /* that are drawn */
#endif
#ifndef OTHERS
#define OTHERS 0 /* meshes of further views, which show in holes of those */
#endif
#ifndef SHEETS
#define SHEETS 0 /* meshes of what segmentation took out */
#endif
#ifndef BACKS
#define BACKS 0 /* meshes turned round: their backs are drawn */
#endif
#define CLOSED (SHEETS + BACKS > 0) /* surface that no view saw is closed (closing.h) */
#define BLEND_QUALITY 0
#define BLEND_POSITION 1
#define BLEND_NEAREST 2
#ifndef BLEND
#define BLEND BLEND_QUALITY /* what colours are weighted by, as the file's head says */
#endif
#ifndef OCCUPIED
#define OCCUPIED 0 /* 1: which views gave colour is written, too */
#endif
#define UNSEEN_MESHES (SHEETS + BACKS) /* meshes that are none of what is seen themselves */
#define MESHES (OTHERS + VIEWS)
#define LEVEL_BIAS 0.25f /* of a level, from which on the coarser one is read: rather a little grain than blur */
#define QUALITY_MIN 1e-3f /* so that what is seen edge-on by all views still has a colour */

/* Where in list[first, last), in ascending order, are the numbers from `number` on? */
int place_in(global const int *list, int first, int last, int number)
{
    while (first < last) {
        const int middle = (first + last) / 2;
        if (list[middle] < number)
            first = middle + 1;
        else
            last = middle;
    }
    return first;
}

#if CLOSED
/* Is there a pixel that no view's mesh covers? */
int has_holes(const Region *seen)
{
    for (int block = 0; block < BLOCKS; block++) {
        floatl front = seen[OTHERS].nearness[block];
        for (int mesh = OTHERS + 1; mesh < MESHES; mesh++)
            front = max_lanes(seen[mesh].nearness[block], front);
        if (any_lane(front == EMPTY))
            return 1;
    }
    return 0;
}

/* Of the pixels (x, y), which show a surface that no view saw? Some rays are `within` a solid up to nearness `back`, some
 * go `through` a sheet. */
intl is_closed(const FreeSpace *space, floatl x, floatl y, floatl back, intl within, floatl sheet, intl through, floatl *n)
{
    floatl depth = DEPTH_OF(space->perspective, pick(within, back, (floatl)1.0f)), entry = depth;
    const intl solid = has_entered(space, x, y, depth, within, &entry);
    depth = DEPTH_OF(space->perspective, pick(through, sheet, (floatl)1.0f)) + space->stride;
    floatl last;
    intl ends = ends_hidden(space, x, y, depth, through & !solid, &last);
    floatl rim, behind;
    const intl on_rim = meets_boundary(space, x, y, last, ends, &rim);
    const intl on_far = leaves_free_space(space, space->open, 0, x, y, last, ends & !on_rim, &behind);
    *n = DEPTH_OF(space->perspective, pick(solid, entry, pick(on_rim, rim, behind)));
    return solid | on_rim | on_far;
}
#endif

/* Adds the colour at the pixel (x, y) of a view's level: of its samples linear within the cell's triangle, of a coarser
 * level bilinear, by how much of each texel has samples. */
void add_sample(global const uint *colors, global const int *size, int level, floatl x, floatl y, floatl weight, Color *sum)
{
    const int width = size[0], height = size[1];
    const float per_texel = 1.0f / (1 << level);
    const floatl u = (x + 0.5f) * per_texel - 0.5f, v = (y + 0.5f) * per_texel - 0.5f, none = 0.0f;
    const Taps taps = clamped_taps(width, height, u, v);
    const floatl fx = taps.fx, fy = taps.fy, gx = 1.0f - fx, gy = 1.0f - fy;
    floatl share[4];
    tap_weights(taps.fx, taps.fy, share);
    if (level == 0) {
        const intl main = ((taps.column ^ taps.row) & 1) == 0; /* the diagonal runs to the lower right (depthmesh/tree.h) */
        share[0] = pick(main, min_lanes(gx, gy), max_lanes(gx - fy, none));
        share[1] = pick(main, max_lanes(fx - fy, none), min_lanes(fx, gy));
        share[2] = pick(main, max_lanes(fy - fx, none), min_lanes(gx, fy));
        share[3] = pick(main, min_lanes(fx, fy), max_lanes(fx - gy, none));
    }
    Color read = {0.0f, 0.0f, 0.0f};
    floatl opaque = 0.0f;
    for (int k = 0; k < 4; k++) {
        const intl word = texels_at(colors, size[2] + taps.at[k]);
        const floatl part = share[k] * to_floatl(word >> 24 & 255);
        add_color(&read, part, color_of(word));
        opaque += part;
    }
    add_color(sum, weight / max_lanes(opaque, (floatl)1e-6f), read);
}

/* Draws the meshes [first, last) from a bin's list, into `regions` regions: each into one of its own, or all into one. */
void draw_range(const Context *context, Region *seen, int regions, global const int *list, global const int *starts,
                global const int *firsts, int first, int last, global const float *depth, int x, int y)
{
    int next = place_in(list, starts[0], starts[1], firsts[first]);
    for (int region = 0; region < regions; region++) {
        const int end = place_in(list, next, starts[1], firsts[last - regions + region + 1]);
        begin_region(&seen[region], context->screen, depth, 1, x, y);
        draw_list(context, &seen[region], list, next, end, x, y);
        next = end;
    }
}

/* What the colours of the meshes are made from */
typedef struct {
    global const int *firsts, *sources, *levels;
    global const float *points, *scales, *weights;
    global const uint *colors;
} Meshes;

/* Adds a mesh's colour where it is `given`, with its weight, which is returned. seen: the mesh's own region; (x, y): the
 * block's first pixel */
INLINED floatl add_mesh(const Context *context, const Meshes *meshes, int mesh, const Region *seen, int block, int x, int y,
                        intl shares, intl given, Color *sum)
{
    const floatl n = seen->nearness[block], px = to_floatl(x + block_x), py = to_floatl(y + block_y);
    const intl triangle = pick(shares, seen->owner[block], meshes->firsts[mesh] + (intl)0);
    const OnTriangle p = on_triangle(context->corners, context->projected, triangle, px, py);
    floatl at_x = 0.0f, at_y = 0.0f, at_z = 0.0f, quality = 0.0f;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        floatl at[4];
        gather_rows(meshes->points, p.corner[k], at);
        at_x += p.weight[k] * at[0];
        at_y += p.weight[k] * at[1];
        at_z += p.weight[k] * at[2];
        quality += p.weight[k] * at[3];
    }
#if BLEND == BLEND_QUALITY
    const floatl weight = pick(given, meshes->weights[mesh] * max_lanes(quality, (floatl)QUALITY_MIN), (floatl)0.0f);
#else
    const floatl weight = pick(given, (floatl)meshes->weights[mesh], (floatl)0.0f);
#endif
    global const int *source = meshes->sources + 4 * mesh;
    const floatl inverse = source[3] ? 1.0f / at_z : (floatl)1.0f;
    const floatl sound_x = pick(shares, at_x * inverse, (floatl)0.0f), sound_y = pick(shares, at_y * inverse, (floatl)0.0f);
    /* One level for the block: that of the pixel that sees the view largest, which blurs nothing */
    const floatl away = context->screen.perspective ? 1.0f / n : (floatl)1.0f;
    const float samples = least_lane(pick(shares, meshes->scales[mesh] * away * inverse, (floatl)INFINITY));
    const int level = (int)fmin(floor(log2(fmax(samples, 1.0f)) + LEVEL_BIAS), (float)(source[2] - source[1]));
    add_sample(meshes->colors, meshes->levels + 3 * (source[1] + level), level, sound_x, sound_y, weight, sum);
    return weight;
}

#if OCCUPIED
/* Writes which views gave a block's pixels their colours; x, y: its first pixel. */
void write_occupancy(intl views, Screen screen, int x, int y, global uint *occupancy)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, x, y, lane);
        if (at >= 0)
            occupancy[at] = int_lane(views, lane);
    }
}
#endif

kernel void draw_meshes(global const int *corners, global const float *projected, global const float *points,
                        global const int *list, global const int *starts, int bins_x, global const int *firsts,
                        global const int *sources, global const int *levels, global const float *scales,
                        global const uint *colors, global const float *weights,
                        global float *depth, global channel *color, global uchar *valid, Screen screen, float nearest_w,
                        int culled, float epsilon, int blank
#if CLOSED
                        ,
                        global const float *limits, global const float *behind, global const uint *far_colors,
                        global const float *clear, global const float *open, global const int *limit_sizes, global const float *from_target,
                        global const int *perspectives, global const int *first_levels, global const float *closeness,
                        float stride
#endif
#if OCCUPIED
                        ,
                        global uint *occupancy
#endif
)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= screen.width || y >= screen.height)
        return;
    const Context context = {corners, projected, screen, nearest_w, culled};
    const Meshes meshes = {firsts + UNSEEN_MESHES, sources, levels, points, scales, weights, colors};
    const int bin = y / BIN * bins_x + x / BIN;
    global const int *here = starts + bin;
    Region seen[MESHES], shown;
    int first_mesh = OTHERS;
    draw_range(&context, seen + OTHERS, VIEWS, list, here, firsts, UNSEEN_MESHES + OTHERS, UNSEEN_MESHES + MESHES, depth, x, y);
#if CLOSED
    const FreeSpace space = {limits, behind, far_colors, clear, open, limit_sizes, from_target,
                           perspectives, first_levels, closeness, stride, screen.perspective};
    Region sheets, backs;
    draw_range(&context, &backs, 1, list, here, firsts, SHEETS, UNSEEN_MESHES, depth, x, y);
    if (has_holes(seen)) {
        first_mesh = 0;
        draw_range(&context, seen, OTHERS, list, here, firsts, UNSEEN_MESHES, UNSEEN_MESHES + OTHERS, depth, x, y);
        draw_range(&context, &sheets, 1, list, here, firsts, 0, SHEETS, depth, x, y);
    }
#endif
    begin_region(&shown, screen, depth, blank, x, y);

    for (int block = 0; block < BLOCKS; block++) {
        const int first_x = x + FIRST_X(block), first_y = y + FIRST_Y(block);
        floatl front = EMPTY;
        for (int mesh = OTHERS; mesh < MESHES; mesh++)
            front = max_lanes(seen[mesh].nearness[block], front);
        const intl hole = front == EMPTY; /* in the meshes of the views that are drawn */
        for (int mesh = first_mesh; mesh < OTHERS; mesh++)
            front = pick(hole, max_lanes(seen[mesh].nearness[block], front), front);
        intl closed = (intl)0;
#if CLOSED
        const floatl back = backs.nearness[block], sheet = first_mesh == 0 ? sheets.nearness[block] : (floatl)EMPTY;
        const intl within = front < (screen.perspective ? back / (1.0f + epsilon * back) : back - epsilon);
        const intl through = (front == EMPTY) & (sheet > EMPTY);
        if (any_lane(within | through)) {
            const floatl px = to_floatl(first_x + block_x), py = to_floatl(first_y + block_y);
            floatl n;
            closed = is_closed(&space, px, py, back, within, sheet, through, &n);
            closed = closed & (n <= screen.nearest);
            front = pick(closed, n, front);
        }
#endif
        const intl mine = front > shown.nearness[block];
        if (!blank && !any_lane(mine))
            continue;
        Color sum = {0.0f, 0.0f, 0.0f};
        floatl total = 0.0f;
        intl taken = (intl)0, views = (intl)0; /* by the front mesh; views that gave colour */
        /* Of epsilon 0 this is `front` itself. */
        const floatl deepest = screen.perspective ? front / (1.0f + epsilon * front) : front - epsilon;
        for (int mesh = first_mesh; mesh < MESHES; mesh++) {
            const floatl n = seen[mesh].nearness[block];
            intl shares = (seen[mesh].owner[block] >= 0) & (mesh < OTHERS ? hole : !hole);
            shares = shares & (BLEND == BLEND_NEAREST ? (n == front) & !taken : n >= deepest);
            taken = taken | shares;
            const intl given = shares & mine;
            if (!any_lane(given))
                continue;
            total += add_mesh(&context, &meshes, mesh, &seen[mesh], block, first_x, first_y, shares, given, &sum);
            views |= pick(given, (intl)(1 << sources[4 * mesh]), (intl)0);
        }
#if CLOSED
        const intl given = closed & mine;
        if (any_lane(given))
            total += add_closest(&space, colors, levels, to_floatl(first_x + block_x), to_floatl(first_y + block_y), front,
                                 given, &sum, &views);
#endif
        const floatl scale = 1.0f / (255.0f * pick(mine, total, (floatl)1.0f));
        const Color shade = {sum.r * scale, sum.g * scale, sum.b * scale};
        shown.nearness[block] = front;
        shown.owner[block] = pick(mine, (intl)0, (intl)-1);
        write_block(&shown, block, screen, depth, color, valid, blank, first_x, first_y, shade);
#if OCCUPIED
        write_occupancy(views, screen, first_x, first_y, occupancy);
#endif
    }
}
