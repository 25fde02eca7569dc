/* States of the quadtree's triangles, from fine to coarse: whether all, some or none of a triangle's cells are drawn
 * (Pajarola, Sainz & Meng 2003, section 3.3).
 *
 * The state of a triangle is the union of the states of its two halves, which are sides of two children of the vertex
 * that splits it. In a block that is squeezed into the image (tree.h), the diagonal does not pass through the centre,
 * so each side gets the union of both sides' states.
 *
 * cells: samples.cl. states: (side + 1, row) states of both sides of each vertex (tree.h). Work-item:
 * `find_finest_states`: a row of vertices; writes the states of step 1, and 0 for other vertices. `find_states`: a row
 * of a coarser step. `find_coarse_states`: all rows of all coarser steps. Cost: O(vertices). Determinism: nothing
 * depends on an order.
 */
#include "depthmesh/tree.h"

kernel void find_finest_states(global const uchar *cells, global uchar *states, Layout layout)
{
    const int y = get_global_id(0), across = !(y & 1);
    if (y > layout.side)
        return;
    for (int first = 0; first <= layout.side; first += LANES) {
        const intl x = first + lane_index, odd = (x & 1) == 1, main = IS_MAIN(x, (intl)y, 1);
        intl byte = (intl)0;
        if (first < layout.width && y < layout.height && layout.side > 1) {
            const intl upper_left = cell_next_to(&layout, cells, x, first, y, -1, -1);
            const intl upper_right = cell_next_to(&layout, cells, x, first, y, 0, -1);
            const intl lower_left = cell_next_to(&layout, cells, x, first, y, -1, 0);
            const intl lower_right = cell_next_to(&layout, cells, x, first, y, 0, 0);
            /* States of the triangles at the vertex: on its left and right, above and below it */
            const intl left = STATE_B(upper_left) | STATE_A(lower_left),
                       right = STATE_A(lower_right) | STATE_B(upper_right);
            const intl above = STATE_B(upper_left) | STATE_B(upper_right),
                       below = STATE_A(lower_left) | STATE_A(lower_right);
            /* In the block around a centre: states of the triangles that do not touch the centre */
            const intl top = STATE_A(upper_left) | STATE_A(upper_right),
                       bottom = STATE_B(lower_left) | STATE_B(lower_right);
            const intl a = across ? above : select_lanes(odd, top | select_lanes(main, right, left), left);
            const intl b = across ? below : select_lanes(odd, bottom | select_lanes(main, left, right), right);
            const intl squeezed = odd & (across ? (intl)0 : is_squeezed(&layout, x, (intl)y, 1));
            const intl either = select_lanes(squeezed, a | b, (intl)0), both = a | either | (b | either) << 2;
            byte = across ? select_lanes(odd, both, byte) : both;
        }
        store_bytes(to_ucharl(byte), states + (size_t)y * layout.row + first);
    }
}

/* Finds the states of row y of the vertices of step s > 1. */
void find_state_row(const Layout *layout, global uchar *states, int s, int y, int centers)
{
    const int side = layout->side, row = layout->row, half_step = s / 2;
    const int across = !(y / s & 1); /* are the midpoints of this row on edges along x? */
    for (int x = centers || across ? s : 0; x <= side && x - s < layout->width - 1; x += 2 * s) {
        global uchar *at = states + (size_t)y * row + x;
        if (centers) {
            const int above = at[-s * row], below = at[s * row], main = IS_MAIN(x, y, s);
            const int left = STATE_B(at[-s]), right = STATE_A(at[s]);
            const int a = STATE_B(above) | (main ? right : left), b = STATE_A(below) | (main ? left : right);
            const int either = x + s >= layout->width || y + s >= layout->height ? a | b : 0;
            *at = a | either | (b | either) << 2;
            continue;
        }
        const int up = -half_step * row, down = half_step * row;
        const int upper_left = x > 0 && y > 0 ? STATE_B(at[up - half_step]) : 0;
        const int upper_right = x < side && y > 0 ? STATE_B(at[up + half_step]) : 0;
        const int lower_left = x > 0 && y < side ? STATE_A(at[down - half_step]) : 0;
        const int lower_right = x < side && y < side ? STATE_A(at[down + half_step]) : 0;
        const int a = upper_left | (across ? upper_right : lower_left),
                  b = lower_right | (across ? lower_left : upper_right);
        *at = a | b << 2;
    }
}

kernel void find_states(global uchar *states, Layout layout, int s, int centers)
{
    const int y = centers ? s + 2 * s * (int)get_global_id(0) : s * (int)get_global_id(0);
    if (y <= layout.side && y - s < layout.height - 1)
        find_state_row(&layout, states, s, y, centers);
}

kernel void find_coarse_states(global uchar *states, Layout layout, int finest)
{
    if (get_global_id(0) > 0)
        return;
    for (int s = finest; s < layout.side; s *= 2) {
        for (int y = 0; y <= layout.side && y - s < layout.height - 1; y += s)
            find_state_row(&layout, states, s, y, 0);
        for (int y = s; y <= layout.side && y - s < layout.height - 1; y += 2 * s)
            find_state_row(&layout, states, s, y, 1);
    }
}
