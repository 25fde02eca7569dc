/* Triangulations within a vertical error, fine to coarse: independent of any view.
 *
 * A vertex stays active if a child is, if its removal would lose drawn triangles, or if one of the two triangles that
 * would be left departs in depth by more than max_error from any sample within it, not only from the vertex: the bound
 * holds at every sample. Planes are straight in nearness, so departures are exact for both kinds of cameras.
 *
 * nearness: (height, pitch). errors, states: errors.cl. active: (side + 1, row), 1 or 0.
 * Work-item: a row of vertices of one step (`merge`), all rows of all coarser steps (`merge_coarse`). Cost: O(samples
 * log samples) at most. Determinism: every vertex on its own.
 */
#include "depthmesh/tree.h"

typedef struct {
    global const float *nearness;
    global const float *errors;
    global const uchar *states;
    global uchar *active;
    float max_error;
} Tree;

/* Does a sample within the triangle of the samples a, b and c lie off its plane? */
int departs(const Layout *layout, const Tree *tree, int2 a, int2 b, int2 c)
{
    const int2 low = min(a, min(b, c)), high = max(a, max(b, c)), ab = b - a, ac = c - a;
    const int area = ab.x * ac.y - ab.y * ac.x, turns = area < 0 ? -1 : 1, size = turns * area;
    const float inverse = 1.0f / size, na = tree->nearness[a.y * layout->pitch + a.x];
    const float nb = tree->nearness[b.y * layout->pitch + b.x] - na, nc = tree->nearness[c.y * layout->pitch + c.x] - na;
    for (int y = low.y; y <= high.y; y++)
        for (int first = low.x; first <= high.x; first += LANES) {
            const intl x = first + lane_index, dx = x - a.x, dy = (intl)(y - a.y);
            const intl to_b = (dx * ac.y - dy * ac.x) * turns, to_c = (dy * ab.x - dx * ab.y) * turns;
            const intl within = (x <= high.x) & (to_b >= 0) & (to_c >= 0) & (to_b + to_c <= size);
            if (!any_lane(within))
                continue;
            const floatl n = load_lanes(tree->nearness + y * layout->pitch + first);
            const floatl plane = na + (to_floatl(to_b) * nb + to_floatl(to_c) * nc) * inverse;
            if (any_lane(within & (fabs(DEPTH_OF(*layout, plane) - DEPTH_OF(*layout, n)) > tree->max_error)))
                return 1;
        }
    return 0;
}

void merge_row(const Layout *layout, const Tree *tree, int s, int y, int centers)
{
    const int across = !(y / s & 1), half_step = s / 2, side = layout->side;
    for (int x = centers || across ? s : 0; x <= side && x - s < layout->width - 1; x += 2 * s) {
        const int at = y * layout->row + x;
        if (tree->errors[at] < 0.0f)
            continue;
        int stays = 0;
        if (centers)
            stays = tree->active[at - s] | tree->active[at + s] | tree->active[at - s * layout->row] |
                    tree->active[at + s * layout->row];
        else if (s > 1)
            for (int k = 0; k < 4; k++) {
                const int cx = x + (k & 1 ? half_step : -half_step), cy = y + (k >> 1 ? half_step : -half_step);
                if (cx >= 0 && cx <= side && cy >= 0 && cy <= side)
                    stays |= tree->active[cy * layout->row + cx];
            }
        const int state[2] = {STATE_A(tree->states[at]), STATE_B(tree->states[at])};
        const int rises = centers && !IS_MAIN(x, y, s); /* the diagonal runs to the upper right */
        const int2 p = (int2)(x, y), along = centers ? (int2)(s, rises ? -s : s) : across ? (int2)(s, 0) : (int2)(0, s);
        const int2 to_a = centers ? (int2)(rises ? -s : s, -s) : across ? (int2)(0, -s) : (int2)(-s, 0);
        for (int k = 0; k < 2 && !stays; k++)
            stays = state[k] == (UNDRAWN | DRAWN) ||
                    (state[k] == DRAWN && departs(layout, tree, p - along, p + along, k ? p - to_a : p + to_a));
        tree->active[at] = stays;
    }
}

kernel void merge(global const float *nearness, global const float *errors, global const uchar *states,
                  global uchar *active, Layout layout, float max_error, int s, int centers)
{
    const int y = centers ? s + 2 * s * (int)get_global_id(0) : s * (int)get_global_id(0);
    if (y > layout.side || y - s >= layout.height - 1)
        return;
    const Tree tree = {nearness, errors, states, active, max_error};
    merge_row(&layout, &tree, s, y, centers);
}

kernel void merge_coarse(global const float *nearness, global const float *errors, global const uchar *states,
                         global uchar *active, Layout layout, float max_error, int finest)
{
    if (get_global_id(0) > 0)
        return;
    const Tree tree = {nearness, errors, states, active, max_error};
    for (int s = finest; s < layout.side; s *= 2) {
        for (int y = 0; y <= layout.side && y - s < layout.height - 1; y += s)
            merge_row(&layout, &tree, s, y, 0);
        for (int y = s; y <= layout.side && y - s < layout.height - 1; y += 2 * s)
            merge_row(&layout, &tree, s, y, 1);
    }
}
