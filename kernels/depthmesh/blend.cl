/* Depth meshes of several views, blended per pixel (Pajarola, Sainz & Meng 2003, sections 4.3 to 4.5).
 *
 * A region's pixels see each mesh's nearest surface first (the depth pass), then those of them that lie within epsilon
 * behind the front one give their colours (the colour pass), weighted and normalised at once. Where segmentation leaves
 * a hole in all meshes, coarse ones without it (UNDERLAID) show through, but not where any view has seen that there is
 * nothing.
 * BLEND_QUALITY: weights of positions times quality, per pixel (the paper's); BLEND_POSITION: of positions alone;
 * BLEND_NEAREST: the front mesh's colour.
 *
 * Deviations from the paper: a mesh's own hidden surfaces are left out within epsilon, too; textures are projected, not
 * stretched over triangles, and read within the source's triangles, so that no colour leaks over a depth edge; what
 * bridges surfaces in the coarse meshes is kept out of empty space.
 *
 * corners, projected, points: select.cl, mesh by mesh: UNDERLAID coarse ones, then those of VIEWS views. list, starts:
 * raster/bins.cl. firsts: (meshes + 1,) each mesh's first triangle. sources: (meshes, 4) number of its view, of the first
 * and the last of that view's levels, and 1 for a perspective view. levels: (levels, 3) width, height and start in colors,
 * each half as large as the one before, rounded up. scales: (meshes,) samples of the view to pixels of the target that a
 * scene unit takes at depth 1 of both. colors: RGBA bytes, A = 255 times the part that has samples. weights: (meshes,)
 * positional, > 0. culled: raster/triangle.h. With UNDERLAID, of ALL views there are: limits, their
 * depths, INFINITY for background and 0 where nothing is known; limit_sizes: (ALL, 3) width, height and start;
 * from_target, (ALL, 16) from the target's pixel space to theirs; perspectives: 1 or 0. depth, color, valid: the picture,
 * which keeps what is nearer already. occupancy: (height, width) bit k is set where view k gave colour, with OCCUPIED.
 * Work-item: a region (raster/region.h). Cost: O(list + pixels * meshes). Determinism: list order, then the meshes'.
 */
#include "lib/color.h"
#include "lib/taps.h"
#include "raster/nearest.h"

#ifndef VIEWS
#define VIEWS 1 /* that are drawn */
#endif
#ifndef UNDERLAID
#define UNDERLAID 0 /* how many coarse meshes there are under the holes */
#endif
#define BLEND_QUALITY 0
#define BLEND_POSITION 1
#define BLEND_NEAREST 2
#ifndef BLEND
#define BLEND BLEND_QUALITY /* what colours are weighted by, as the file's head says */
#endif
#ifndef OCCUPIED
#define OCCUPIED 0 /* 1: which views gave colour is written, too */
#endif
#ifndef ALL
#define ALL VIEWS /* views there are, drawn or not */
#endif
#define MESHES (VIEWS + UNDERLAID)
#define HALFWAY 0.25f /* of a level, from which on the coarser one is read: rather a little grain than blur */
#define LEAST_QUALITY 1e-3f /* so that what is seen edge-on by all views still has a colour */

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

#if UNDERLAID
/* Has a view seen through the target's pixel (x, y) at nearness n, with all four samples around it? */
intl is_empty(global const float *limits, global const int *sizes, global const float *from_target,
              global const int *perspectives, floatl x, floatl y, floatl n, float epsilon)
{
    intl empty = (intl)0;
    for (int view = 0; view < ALL; view++) {
        global const float *m = from_target + 16 * view;
        const int width = sizes[3 * view], height = sizes[3 * view + 1];
        const floatl inverse = 1.0f / MAP_ROW(m, 2, x, y, n), near = MAP_ROW(m, 3, x, y, n) * inverse;
        const floatl u = MAP_ROW(m, 0, x, y, n) * inverse, v = MAP_ROW(m, 1, x, y, n) * inverse;
        const floatl z = DEPTH_OF(perspectives[view], near);
        intl through = (inverse > 0.0f) & (z > 0.0f) & (u >= 0.0f) & (v >= 0.0f) & (u < width - 1.0f) & (v < height - 1.0f);
        const intl first = sizes[3 * view + 2] + pick(through, to_intl(v) * width + to_intl(u), (intl)0);
        for (int k = 0; k < 4; k++) {
            const intl at = first + (k & 1) + (k >> 1) * width;
            through = through & (z < (floatl)(gather(limits, at)) - epsilon);
        }
        empty = empty | through;
    }
    return empty;
}

/* Is there a pixel that no mesh covers? */
int has_holes(const Region *seen)
{
    for (int block = 0; block < BLOCKS; block++) {
        floatl front = seen[0].nearness[block];
        for (int mesh = 1; mesh < VIEWS; mesh++)
            front = greater(seen[mesh].nearness[block], front);
        if (any_lane(front == EMPTY))
            return 1;
    }
    return 0;
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
    tap_weights(taps, share);
    if (level == 0) {
        const intl main = ((taps.column ^ taps.row) & 1) == 0; /* the diagonal runs to the lower right (depthmesh/tree.h) */
        share[0] = pick(main, lesser(gx, gy), greater(gx - fy, none));
        share[1] = pick(main, greater(fx - fy, none), lesser(fx, gy));
        share[2] = pick(main, greater(fy - fx, none), lesser(gx, fy));
        share[3] = pick(main, lesser(fx, fy), greater(fx - gy, none));
    }
    Color read = {0.0f, 0.0f, 0.0f};
    floatl opaque = 0.0f;
    for (int k = 0; k < 4; k++) {
        const intl word = texels_at(colors, size[2] + taps.at[k]);
        const floatl part = share[k] * to_floatl(word >> 24 & 255);
        add_color(&read, part, color_of(word));
        opaque += part;
    }
    add_color(sum, weight / greater(opaque, (floatl)1e-6f), read);
}

/* Draws the meshes [first, last), each into a region of its own, from a bin's list. */
void draw_each(const Context *context, Region *seen, global const int *list, global const int *starts, global const int *firsts,
               int first, int last, global const float *depth, int x, int y)
{
    int next = place_in(list, starts[0], starts[1], firsts[first]);
    for (int mesh = first; mesh < last; mesh++) {
        const int end = place_in(list, next, starts[1], firsts[mesh + 1]);
        begin_region(&seen[mesh], context->screen, depth, 1, x, y);
        draw_list(context, &seen[mesh], list, next, end, x, y);
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
    for (int k = 0; k < 3; k++) {
        const intl row = 4 * p.corner[k], row_y = row + 1, row_z = row + 2, row_q = row + 3;
        at_x += p.weight[k] * (floatl)(gather(meshes->points, row));
        at_y += p.weight[k] * (floatl)(gather(meshes->points, row_y));
        at_z += p.weight[k] * (floatl)(gather(meshes->points, row_z));
        quality += p.weight[k] * (floatl)(gather(meshes->points, row_q));
    }
#if BLEND == BLEND_QUALITY
    const floatl weight = pick(given, meshes->weights[mesh] * greater(quality, (floatl)LEAST_QUALITY), (floatl)0.0f);
#else
    const floatl weight = pick(given, (floatl)meshes->weights[mesh], (floatl)0.0f);
#endif
    global const int *source = meshes->sources + 4 * mesh;
    const floatl inverse = source[3] ? 1.0f / at_z : (floatl)1.0f;
    const floatl sound_x = pick(shares, at_x * inverse, (floatl)0.0f), sound_y = pick(shares, at_y * inverse, (floatl)0.0f);
    /* One level for the block: that of the pixel that sees the view largest, which blurs nothing */
    const floatl away = context->screen.perspective ? 1.0f / n : (floatl)1.0f;
    const float samples = least_lane(pick(shares, meshes->scales[mesh] * away * inverse, (floatl)INFINITY));
    const int level = (int)fmin(floor(log2(fmax(samples, 1.0f)) + HALFWAY), (float)(source[2] - source[1]));
    add_sample(meshes->colors, meshes->levels + 3 * (source[1] + level), level, sound_x, sound_y, weight, sum);
    return weight;
}

kernel void draw_meshes(global const int *corners, global const float *projected, global const float *points,
                        global const int *list, global const int *starts, int bins_x, global const int *firsts,
                        global const int *sources, global const int *levels, global const float *scales,
                        global const uint *colors, global const float *weights,
                        global float *depth, global channel *color, global uchar *valid, Screen screen, float nearest_w,
                        int culled, float epsilon, int blank
#if UNDERLAID
                        ,
                        global const float *limits, global const int *limit_sizes, global const float *from_target,
                        global const int *perspectives
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
    const Meshes meshes = {firsts, sources, levels, points, scales, weights, colors};
    const int bin = y / BIN * bins_x + x / BIN;
    Region seen[MESHES], shown;
    int first_mesh = UNDERLAID;
    draw_each(&context, seen, list, starts + bin, firsts, UNDERLAID, MESHES, depth, x, y);
#if UNDERLAID
    if (has_holes(seen + UNDERLAID)) {
        first_mesh = 0;
        draw_each(&context, seen, list, starts + bin, firsts, 0, UNDERLAID, depth, x, y);
    }
#endif
    begin_region(&shown, screen, depth, blank, x, y);

    for (int block = 0; block < BLOCKS; block++) {
        const int first_x = x + FIRST_X(block), first_y = y + FIRST_Y(block);
        floatl front = EMPTY;
        intl under = (intl)0; /* nothing but coarse meshes */
        for (int mesh = UNDERLAID; mesh < MESHES; mesh++)
            front = greater(seen[mesh].nearness[block], front);
#if UNDERLAID
        under = front == EMPTY;
        for (int mesh = first_mesh; mesh < UNDERLAID; mesh++) {
            const intl covered = under & (seen[mesh].owner[block] >= 0);
            if (!any_lane(covered))
                continue;
            const floatl n = seen[mesh].nearness[block], px = to_floatl(first_x + block_x), py = to_floatl(first_y + block_y);
            const intl kept = covered & !is_empty(limits, limit_sizes, from_target, perspectives, px, py,
                                                  pick(covered, n, (floatl)1.0f), epsilon);
            seen[mesh].owner[block] = pick(kept, seen[mesh].owner[block], (intl)-1);
            front = pick(kept, greater(n, front), front);
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
            intl shares = (seen[mesh].owner[block] >= 0) & (mesh < UNDERLAID ? under : !under);
            shares = shares & (BLEND == BLEND_NEAREST ? (n == front) & !taken : n >= deepest);
            taken = taken | shares;
            const intl given = shares & mine;
            if (!any_lane(given))
                continue;
            total += add_mesh(&context, &meshes, mesh, &seen[mesh], block, first_x, first_y, shares, given, &sum);
            views |= pick(given, (intl)(1 << sources[4 * mesh]), (intl)0);
        }
        const floatl scale = 1.0f / (255.0f * pick(mine, total, (floatl)1.0f));
        const Color shade = {sum.r * scale, sum.g * scale, sum.b * scale};
        shown.nearness[block] = front;
        shown.owner[block] = pick(mine, (intl)0, (intl)-1);
        write_block(&shown, block, screen, depth, color, valid, blank, first_x, first_y, shade);
#if OCCUPIED
        for (int lane = 0; lane < LANES; lane++) {
            const long at = pixel_of(screen, first_x, first_y, lane);
            if (at >= 0)
                occupancy[at] = int_lane(views, lane);
        }
#endif
    }
}
