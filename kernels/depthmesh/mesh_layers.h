#ifndef DEPTHMESH_MESH_LAYERS_H
#define DEPTHMESH_MESH_LAYERS_H
/* The depth pass of blended depth meshes (Pajarola, Sainz & Meng 2003, section 4.3): the nearest surface of each mesh
 * at the pixels of a region (raster/region.h), for the colour pass in blend.cl.
 *
 * The results are stored in global memory, as private memory is too small for all meshes. Other views and sheets are
 * drawn only in holes of the drawn views.
 */
#include "raster/nearest.h"

#ifndef CLOSED
#define CLOSED 0 /* BY_RAYS: surface that no view saw is drawn (closing.h). BY_SHEETS: other meshes fill holes */
#endif
#define BY_RAYS 1
#define BY_SHEETS 2

/* The number of meshes of each kind; meshes are stored in this order. Sheets (triangles that segmentation removed) and
 * backs (meshes with fronts and backs exchanged) indicate surface that no view saw. Others are the meshes of views that
 * are not drawn; they show in holes. */
typedef struct {
    int sheets, backs, others, views;
} MeshCounts;

/* The first place in a bin's list whose triangle is `number` or greater; the list is in ascending order */
int lower_bound(BinList listed, int number)
{
    int first = listed.first, last = listed.last;
    while (first < last) {
        const int middle = (first + last) / 2;
        if (listed.list[middle] < number)
            first = middle + 1;
        else
            last = middle;
    }
    return first;
}

/* Draws the meshes `first` to `last` - 1 of a bin's list into the region at (x, y), where they are nearer than
 * `so_far`; the nearest mesh stays. */
INLINED void draw_range(const Context *context, Region *region, BinList listed, global const int *firsts, int first,
                        int last, int x, int y, const floatl *so_far)
{
    BinList range = listed;
    range.first = lower_bound(range, firsts[first]);
    range.last = lower_bound(range, firsts[last]);
    begin_region(region, x, y);
    for (int block = 0; block < BLOCKS; block++) {
        region->nearness[block] = so_far[block];
        region->farthest[block] = least_lane(so_far[block]);
    }
    draw_list(context, region, range);
}

/* The nearness and triangle of each mesh at a region's pixels, in the work-item's part of global memory */
typedef struct {
    global float *nearness;
    global int *owner; /* triangle, -1: none */
    size_t next;       /* elements from one mesh to the next */
} MeshLayers;

/* For each kind of mesh, the nearness of the nearest surface at a region's pixels */
typedef struct {
    floatl views[BLOCKS];
#if CLOSED
    floatl others[BLOCKS];
#endif
#if CLOSED == BY_RAYS
    floatl sheets[BLOCKS], backs[BLOCKS];
#endif
} Fronts;

/* Draws each of the meshes `first` to `last` - 1 into its own layer, where it is nearer than `so_far`. Sets `front` to
 * the nearness of the nearest mesh. */
INLINED void draw_layers(const Context *context, Region *region, const MeshLayers *layers, BinList listed,
                 global const int *firsts, int first, int last, int x, int y, const floatl *so_far, floatl *front)
{
    for (int block = 0; block < BLOCKS; block++)
        front[block] = so_far[block];
    for (int mesh = first; mesh < last; mesh++) {
        draw_range(context, region, listed, firsts, mesh, mesh + 1, x, y, so_far);
        for (int block = 0; block < BLOCKS; block++) {
            const size_t at = mesh * layers->next + LANES * block;
            store_lanes(region->nearness[block], layers->nearness + at);
            store_lanes(region->owner[block], layers->owner + at);
            front[block] = max_lanes(region->nearness[block], front[block]);
        }
    }
}

/* The depth pass for the region at (x, y). Returns whether the meshes of the drawn views leave holes: only then are
 * the other views' meshes and the sheets drawn. */
OUTLINED int draw_depths(const Context *context, const MeshLayers *layers, MeshCounts counts, BinList listed,
                global const int *firsts, int x, int y, Fronts *fronts)
{
    const int unseen = counts.sheets + counts.backs, meshes = counts.others + counts.views;
    Region region;
    floatl so_far[BLOCKS]; /* EMPTY at first; later INFINITY outside holes, so that nothing is drawn there */
    for (int block = 0; block < BLOCKS; block++)
        so_far[block] = EMPTY;
    draw_layers(context, &region, layers, listed, firsts + unseen, counts.others, meshes, x, y, so_far, fronts->views);
    intl holes = (intl)0;
#if CLOSED == BY_RAYS
    draw_range(context, &region, listed, firsts, counts.sheets, unseen, x, y, fronts->views);
    for (int block = 0; block < BLOCKS; block++)
        fronts->backs[block] = select_lanes(region.owner[block] >= 0, region.nearness[block], (floatl)EMPTY);
#endif
#if CLOSED
    for (int block = 0; block < BLOCKS; block++) {
        const intl hole = fronts->views[block] == EMPTY;
        so_far[block] = select_lanes(hole, (floatl)EMPTY, (floatl)INFINITY);
        holes = holes | hole;
    }
    if (any_lane(holes)) {
        draw_layers(context, &region, layers, listed, firsts + unseen, 0, counts.others, x, y, so_far, fronts->others);
#if CLOSED == BY_RAYS
        for (int block = 0; block < BLOCKS; block++)
            so_far[block] = select_lanes(fronts->others[block] == EMPTY, (floatl)EMPTY, (floatl)INFINITY);
        draw_range(context, &region, listed, firsts, 0, counts.sheets, x, y, so_far);
        for (int block = 0; block < BLOCKS; block++)
            fronts->sheets[block] = region.nearness[block];
#endif
    }
#endif
    return any_lane(holes);
}

#endif
