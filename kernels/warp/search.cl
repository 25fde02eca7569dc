/* The O(n^3) inverse warp: every pixel of the target searches its own segment of an epipolar line. The segment leads
 * from the epipole, or from the image's border, to the projection of the point at infinity of the pixel's ray
 * (Schaufler & Priglinger 1999, section 4).
 *
 * hits: (dst_height, dst_pitch), hits.h. counters: with COUNTERS, (dst_height, packets in a row) the number of cells
 * that the packet's slowest lane visits, times LANES. Work-item: LANES pixels of a row. Cost: O(source width) for each
 * pixel. Determinism: pixels are independent.
 */
#include "warp/hits.h"
#include "warp/trace.h"

/* The hits of the rays of LANES pixels of row y, from x on. Adds to `cells` how many the slowest lane visits. */
OUTLINED floatl search_packet(Grid grid, PixelMap map, int sides, int x, int y, int high_x, uint *cells)
{
    const Rays rays = rays_of(map, to_floatl(x + lane_index), (floatl)y);
    const Epipolar epipolar = epipolar_of(rays, grid);
    Windows windows;
    windows.from = 0.0f;
    windows.to = epipolar.lines.length;
    windows.next[0] = INFINITY;
    windows.radius = 0.0f;
    return trace(grid, rays, epipolar, windows, sides, x + lane_index < high_x, cells);
}

kernel void search(global const float *surface, global float *hits, PixelMap map, int sides, int low_x, int high_x,
                   int low_y, int high_y COUNTERS_PARAMETER(uint))
{
    const int x = low_x + get_global_id(0) * LANES, y = low_y + get_global_id(1);
    if (x >= high_x || y >= high_y)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    uint cells = 0;
    const floatl found = search_packet(grid, map, sides, x, y, high_x, &cells);
    store_lanes(found, hits + (size_t)y * map.dst_pitch + x); /* the pitch leaves room for a whole packet */
#if COUNTERS
    counters[y * ((map.dst_width + LANES - 1) / LANES) + get_global_id(0)] = cells * LANES;
#endif
}
