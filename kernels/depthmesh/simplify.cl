/* Triangulations within a vertical error, for no viewer in particular.
 *
 * `find_departures` measures how far the triangle on each side of each vertex departs in depth from the samples within
 * it: from all of them, not only from the vertex, so that it is a bound. Planes are straight in nearness, so departures
 * are exact for both kinds of cameras. `refine` starts from the coarsest triangles and splits those that depart by more
 * than max_error, and what must be split with them. Each split is one that any triangulation within the bound has: no
 * other has fewer triangles.
 *
 * nearness: (height, pitch). states: errors.cl. departures: (2, side + 1, row) scene units, of sides A and B: -1 if nothing
 * of the triangle is drawn, INFINITY if only a part is. active: (side + 1, row), 1 or 0, to be filled with 0 before.
 * queue: as many ints.
 * Work-item: a row of vertices of one step, LANES at once, or, where they are few, LANES samples at once
 * (`find_departures`); everything (`refine`). Cost: O(samples log samples); O(triangles). Determinism: the set that
 * `refine` finds is the same in any order.
 */
#include "depthmesh/tree.h"

#define WIDE 4 /* from this step on triangles are wide enough for their rows' samples to share the lanes */

/* How far planes of nearness p lie off samples of nearness n, in depth */
floatl departure(const Layout *layout, floatl p, floatl n)
{
    return layout->perspective ? fabs(p - n) / fabs(p * n) : fabs(p - n);
}

/* One number of the lanes */
#define FLOAT_OF(lanes) (((const float *)&(lanes))[lane])
#define INT_OF(lanes) (((const int *)&(lanes))[lane])

/* The plane of a side's triangle: nearness at the vertex, and its change from sample to sample */
typedef struct {
    floatl start, along_x, along_y;
} Plane;

/* Of the side b (0: A, 1: B) of vertices at the samples `at`, where it is drawn. A midpoint's edge runs along x (across)
 * or y; a centre's to the lower right (main) or the upper right. */
Plane plane_of(const Layout *layout, global const float *nearness, intl at, int s, int centers, int across, intl main, int b,
               intl drawn)
{
    const int sign = b ? 1 : -1, up = sign * s * layout->pitch, edge = across ? s : s * layout->pitch;
    const int away = across ? up : sign * s; /* from a midpoint to the right angle */
    const intl lean = pick(main, (intl)(-sign * s), (intl)(sign * s)), none = (intl)0;
    const intl corner = pick(drawn, centers ? at + up + lean : at + away, none);
    const intl beside = pick(drawn, centers ? at + up - lean : at - edge, none); /* in the right angle's row, of a centre */
    const intl below = pick(drawn, centers ? at - up + lean : at + edge, none);  /* in its column */
    const floatl q = (floatl)(gather(nearness, corner)), n = (floatl)(gather(nearness, beside)), m = (floatl)(gather(nearness, below));
    const float per_edge = 0.5f / s;
    Plane p;
    p.start = 0.5f * (n + m);
    if (centers) {
        p.along_x = (q - n) * per_edge * to_floatl(pick(main, (intl)-sign, (intl)sign));
        p.along_y = (q - m) * (per_edge * sign);
        return p;
    }
    const floatl along = (m - n) * per_edge, to_q = (q - p.start) * (2.0f * per_edge * sign);
    p.along_x = across ? along : to_q;
    p.along_y = across ? to_q : along;
    return p;
}

/* The samples of such a triangle, relative to the vertex: rows LOW_Y to HIGH_Y, in each those from LOW_X to HIGH_X; turn is
 * 1 where the diagonal is main, else -1 */
#define LOW_Y (centers || !across ? -s : b ? 0 : 1 - s)
#define HIGH_Y (centers || !across ? s : b ? s - 1 : 0)
#define TO_EDGE (s - (dy < 0 ? -dy : dy))
#define LOW_X (centers ? ((turn > 0) == b ? -s : turn * dy) : across || !b ? -TO_EDGE : 0)
#define HIGH_X (centers ? ((turn > 0) == b ? turn * dy : s) : across || b ? TO_EDGE : 0)

/* The largest departure of a triangle around the sample `at`, by rows */
float departure_by_rows(const Layout *layout, global const float *nearness, int at, int s, int centers, int across, int turn,
                        int b, float start, float along_x, float along_y)
{
    floatl most = 0.0f;
    for (int dy = LOW_Y; dy <= HIGH_Y; dy++)
        for (int first = LOW_X; first <= HIGH_X; first += LANES) {
            const intl dx = first + lane_index;
            const floatl off = departure(layout, start + to_floatl(dx) * along_x + dy * along_y,
                                         load_lanes(nearness + at + dy * layout->pitch + first));
            most = pick((dx <= HIGH_X) & (off > most), off, most);
        }
    return -least_lane(-most);
}

kernel void find_departures(global const float *nearness, global const uchar *states, global float *departures,
                            Layout layout)
{
    /* Coarse rows first: they take longer. */
    int row = get_global_id(0), s = layout.side / 2, centers = 0;
    for (; s; s /= 2) {
        const int midpoints = layout.side / s + 1, all = midpoints + layout.side / (2 * s);
        centers = row >= midpoints;
        if (row < all) {
            row -= centers ? midpoints : 0;
            break;
        }
        row -= all;
    }
    if (!s)
        return;
    const int y = centers ? s + 2 * s * row : s * row, across = !(row & 1), step = 2 * s;
    if (y - s >= layout.height - 1)
        return;
    const size_t plane = (size_t)(layout.side + 1) * layout.row;
    for (int start = centers || across ? s : 0; start <= layout.side && start - s < layout.width - 1; start += step * LANES) {
        const intl x = start + step * lane_index, mine = (x <= layout.side) & (x - s < layout.width - 1);
        const intl vertex = pick(mine, y * layout.row + x, (intl)0), byte = (intl)(gather(states, vertex));
        const intl at = y * layout.pitch + x, main = IS_MAIN(x, (intl)y, s);
        floatl finest = 0.0f; /* departure of both sides of a midpoint of step 1: there is no sample but its own */
        if (s == 1 && !centers) {
            const intl either = mine & (((byte | byte >> 2) & DRAWN) != 0), edge = (intl)(across ? 1 : layout.pitch);
            const intl own = pick(either, at, (intl)0), before = pick(either, at - edge, (intl)0), after = pick(either, at + edge, (intl)0);
            finest = departure(&layout, 0.5f * ((floatl)(gather(nearness, before)) + (floatl)(gather(nearness, after))),
                               (floatl)(gather(nearness, own)));
        }
        for (int b = 0; b < 2; b++) {
            const intl state = b ? STATE_B(byte) : STATE_A(byte), drawn = mine & (state == DRAWN);
            floatl most = pick(state == (UNDRAWN | DRAWN), (floatl)INFINITY, pick(drawn, finest, (floatl)-1.0f));
            if ((s > 1 || centers) && any_lane(drawn)) {
                const Plane p = plane_of(&layout, nearness, at, s, centers, across, main, b, drawn);
                if (s < WIDE) {
                    const int turn = 1; /* where it is not, x is mirrored */
                    for (int dy = LOW_Y; dy <= HIGH_Y; dy++)
                        for (int dx = LOW_X; dx <= HIGH_X; dx++) {
                            const intl to_x = centers ? pick(main, (intl)dx, (intl)-dx) : (intl)dx;
                            const intl sample = pick(drawn, at + dy * layout.pitch + to_x, (intl)0);
                            const floatl off = departure(&layout, p.start + to_floatl(to_x) * p.along_x + dy * p.along_y,
                                                         (floatl)(gather(nearness, sample)));
                            most = pick(drawn & (off > most), off, most);
                        }
                } else {
                    for (int lane = 0; lane < LANES; lane++)
                        if (INT_OF(drawn))
                            ((float *)&most)[lane] = departure_by_rows(&layout, nearness, INT_OF(at), s, centers, across,
                                                                       INT_OF(main) ? 1 : -1, b, FLOAT_OF(p.start),
                                                                       FLOAT_OF(p.along_x), FLOAT_OF(p.along_y));
                }
            }
            for (int lane = 0; lane < LANES; lane++)
                if (INT_OF(mine))
                    departures[b * plane + INT_OF(vertex)] = FLOAT_OF(most);
        }
    }
}

/* Takes a vertex in, unless it is one of the tree's corners or beyond. */
int activate(const Layout *layout, global uchar *active, global int *queue, int last, int x, int y)
{
    const int side = layout->side, in = x >= 0 && x <= side && y >= 0 && y <= side;
    if (!in || ((x == 0 || x == side) && (y == 0 || y == side)) || active[y * layout->row + x])
        return last;
    active[y * layout->row + x] = 1;
    queue[last] = y * layout->row + x;
    return last + 1;
}

kernel void refine(global const float *departures, global uchar *active, global int *queue, Layout layout, float max_error)
{
    if (get_global_id(0) > 0 || layout.side < 2)
        return;
    const int row = layout.row, side = layout.side;
    const size_t plane = (size_t)(side + 1) * row;
    const int root = (row + 1) * (side / 2);
    active[side] = active[side * row] = 1; /* the corners at the coarsest triangles' right angles */
    int first = 0, last = 0;
    if (departures[root] > max_error || departures[plane + root] > max_error)
        last = activate(&layout, active, queue, last, side / 2, side / 2);
    for (; first < last; first++) {
        const int y = queue[first] / row, x = queue[first] - y * row, s = step_of(x, y);
        if (IS_CENTER(x, y, s)) {
            const int turn = IS_MAIN(x, y, s) ? s : -s;
            last = activate(&layout, active, queue, last, x + turn, y - s); /* its right angles */
            last = activate(&layout, active, queue, last, x - turn, y + s);
            for (int k = 0; k < 4; k++) { /* above, right, below, left */
                const int cx = x + (k == 1 ? s : k == 3 ? -s : 0), cy = y + (k == 2 ? s : k == 0 ? -s : 0);
                if (departures[(k == 0 || k == 3 ? plane : 0) + cy * row + cx] > max_error)
                    last = activate(&layout, active, queue, last, cx, cy);
            }
        } else {
            const int across = x & s;
            last = activate(&layout, active, queue, last, x - (across ? 0 : s), y - (across ? s : 0));
            last = activate(&layout, active, queue, last, x + (across ? 0 : s), y + (across ? s : 0));
            for (int k = 0; k < 4 && s > 1; k++) {
                const int cx = x + (k & 1 ? s / 2 : -s / 2), cy = y + (k >> 1 ? s / 2 : -s / 2);
                if (cx >= 0 && cx <= side && cy >= 0 && cy <= side && departures[(k >> 1 ? 0 : plane) + cy * row + cx] > max_error)
                    last = activate(&layout, active, queue, last, cx, cy);
            }
        }
    }
}
