/* Objects from images: the intersection of the images' volumes, drawn by slices (Kautz & Seidel 2001, sections 4 and
 * 5).
 *
 * A pixel's ray is clipped to the object's box, and walks the slices in the box from front to back. It stops at the
 * first point that passes the test of every view: the point lies behind the surface of the view's depth image
 * (SILHOUETTES 0), or inside the view's silhouette (SILHOUETTES 1). A view's surface is bilinear in nearness, with
 * creases between samples. Next to a background sample, the surface ends half-way to this sample, like the outline of a
 * mask, or farther out in objects with many views (`outline`). Samples of unknown depth are placed at the box's front.
 *
 * Deviations from the paper: each pixel's ray is intersected with the slices, which are not drawn as polygons, so the
 * stencil passes become one loop. `halvings` bisections move a hit from its slice closer to the surface. With
 * `visible`, only views that see a point give its colour (view_colors.h).
 *
 * matrices: (views, 16) from the world to each view's pixel space. sizes: (views, 3) width, height and start in colors;
 * in maps, the start is twice as large, except for masks. maps: (views, 2, height, width) records.h, or (views, height,
 * width) masks of 0 and 1. surfaces: (views, 2, height, width) records.h, the object's surface as each view sees it:
 * `maps`, or for silhouettes the hull's depth in each view. reaches: (views,) greatest difference in nearness between a
 * view's surface and its samples. colors: RGBA bytes, A = 255 where the view has a sample. order: (views,) views in the
 * order of testing, then views that only give colours. closeness: (views,) cosine of the angle between the view's
 * direction and the target's, > 0. The origin of world coordinates is the box's middle. counters: (height, width) view
 * tests, with COUNTERS. With RIBBONS, firsts: index of each sample's first ribbon, for all views, then the count of all
 * ribbons; ribbons: (N, RIBBON_FLOATS), records.h. Work-item: with LANES 16 a block of 4 x 4 pixels, one to a lane;
 * with LANES 1 a pixel. Cost: O(pixels * slices * views tested). Determinism: fixed order.
 */
#define BIN BLOCK
#include "raster/region.h"
#include "slicing/view_colors.h"

kernel void draw_object(PICTURE_PARAMETERS, Screen screen, global const float *matrices, global const int *sizes,
            global const float *maps, global const float *surfaces, global const float *reaches,
            global const uint *colors, global const int *order, global const float *closeness,
            int view_count /* views that test points */, int colored /* views that give colours */,
            Box box, int slices_axis, int halvings /* bisections in front of a hit */,
            int visible /* 1: colours come from views that see the points, if there are any */,
            int unknown /* 1: a point that projects outside a view's image passes the view's test */,
            float outline /* where views' surfaces end: surface_at() */,
            float sample /* distance of the coarsest view's samples in the middle of the box, in scene units */,
            float stride /* change of depth in the first step from a hit forward to a view's surface */,
            int low_x, int low_y COUNTERS_PARAMETER(int)
#if RIBBONS
                           ,
            global const int *firsts,
            global const float *ribbons
#endif
                GBUFFER_PARAMETERS NORMALS_PARAMETER(uint))
{
    const int x = low_x + get_global_id(0) * BLOCK, y = low_y + get_global_id(1) * BLOCK;
    if (x >= screen.width || y >= screen.height)
        return;
    const Picture picture = PICTURE_VALUE;
    Region region;
    begin_in_picture(&region, &picture, x, y);

    const Views views = {view_count, colored, matrices, sizes, maps, surfaces, reaches, colors, order, closeness,
                         visible, unknown, outline, sample, stride,
#if RIBBONS
                         firsts, ribbons,
#endif
                         NORMALS_ARGUMENT(uint),
    };
    const WorldRay ray = world_ray(screen, BLOCK_X(&region, 0), BLOCK_Y(&region, 0));
    const floatl so_far = region.nearness[0];
    const floatl drawn = select_lanes(so_far <= EMPTY, (floatl)INFINITY, DEPTH_OF(screen.perspective, so_far));
    const RaySegment segment = segment_in_box(box, &ray, screen.perspective ? 1.0f / screen.nearest : 0.0f,
                                              slices_axis);
    floatl hit = 0.0f;
    intl tests = 0, found = intersect_object(&views, &ray, segment, drawn, halvings, &hit, &tests);
    const floatl nearness = DEPTH_OF(screen.perspective, hit);
    found = found & (nearness > so_far); /* the first of several equally near objects stays visible */
    region.nearness[0] = select_lanes(found, nearness, so_far);
    region.owner[0] = select_lanes(found, (intl)0, (intl)-1);
    Color shade = {0.0f, 0.0f, 0.0f}, normal = shade;
    if (any_lane(found)) {
        const Blend blend = blend_at(&views, &ray, segment, hit, halvings, found, &tests);
        const floatl scale = 1.0f / (255.0f * fmax(blend.weight, (floatl)1e-20f));
        shade = color_times(blend.color, scale);
        normal = color_times(blend.normal, scale);
    }
    if (COUNTERS)
        add_to_counters(COUNTERS_ARGUMENT(int), &region, 0, screen, tests);
    const intl written = write_block(&region, 0, &picture, shade);
    const GBuffer gbuffer = GBUFFER_VALUE;
    enter_block(gbuffer, written, &region, 0, &picture, normal);
}
