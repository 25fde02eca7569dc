#ifndef DEPTHMESH_MESH_LAYERS_H
#define DEPTHMESH_MESH_LAYERS_H
/* The depth pass of blended depth meshes (Pajarola, Sainz & Meng 2003, section 4.3): the nearest surface of each mesh
 * that the pixels of a region (raster/region.h) see, for the colour pass in blend.cl.
 *
 * It lies in global memory: for all meshes, that is more than private memory holds. Of views that are not drawn, and of
 * surface that no view saw, what lies in holes of those that are.
 */
#include "raster/nearest.h"

#ifndef CLOSED
#define CLOSED 0 /* BY_RAYS: surface that no view saw is closed (closing.h). BY_SHEETS: others show as they are */
#endif
#define BY_RAYS 1
#define BY_SHEETS 2

/* Numbers of meshes of each kind, in their order. Sheets, of the triangles that segmentation took out, and backs, of
 * meshes whose backs are drawn, tell of surface that no view saw. Others, of views that are not drawn, show in
 * holes. */
typedef struct {
    int sheets, backs, others, views;
} MeshCounts;

/* The first place in the list, whose numbers ascend, at which they are not below `number` */
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

/* Draws the meshes [first, last) of a bin's list together into the region at (x, y), where they are nearer than
 * `so_far`, nearness by block. */
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

/* What a region's pixels see of each mesh by itself, in the work-item's part of global memory */
typedef struct {
    global float *nearness;
    global int *owner; /* triangle, -1: none */
    size_t next;       /* from a mesh's pixels to the next mesh's */
} MeshLayers;

/* Nearness of the nearest that a region's pixels see of the meshes of each kind */
typedef struct {
    floatl views[BLOCKS];
#if CLOSED
    floatl others[BLOCKS];
#endif
#if CLOSED == BY_RAYS
    floatl sheets[BLOCKS], backs[BLOCKS];
#endif
} Fronts;

/* Draws each of the meshes [first, last) by itself, into its layer, where it is nearer than `so_far`; front: nearness
 * of the nearest of them all */
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

/* The depth pass: what the pixels of the region at (x, y) see of each mesh. Returns whether there are holes in the
 * meshes of the views that are drawn: only then are the others' drawn, and the sheets. */
OUTLINED int draw_depths(const Context *context, const MeshLayers *layers, MeshCounts counts, BinList listed,
                global const int *firsts, int x, int y, Fronts *fronts)
{
    const int unseen = counts.sheets + counts.backs, meshes = counts.others + counts.views;
    Region region;
    floatl so_far[BLOCKS]; /* nothing; and beside holes, what no mesh is nearer than */
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
