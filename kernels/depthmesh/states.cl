/* What the quadtree's triangles are made of, fine to coarse: whether all, some or none of the cells within each are drawn
 * (Pajarola, Sainz & Meng 2003, section 3.3: segmentation carried up by boolean rules).
 *
 * A triangle's state is what its two halves' states say together; those are sides of the vertex's children.
 *
 * cells: samples.cl. states: (side + 1, row) of each vertex, both sides' (tree.h).
 * Work-item: a row of vertices of step 1, all of them, one after the other (`find_midpoint_states`, which also writes
 * UNDRAWN for those that no cell belongs to, `find_center_states`), of a coarser step (`find_states`), all rows of all
 * coarser steps (`find_coarse_states`). Cost: O(vertices). Determinism: nothing depends on an order.
 */
#include "depthmesh/tree.h"

/* A centre's byte from those of the midpoints above, to the right, below and to the left */
#define CENTER_BYTE(above, right, below, left, main)                                                           \
    (STATE_B(above) | pick(main, STATE_A(right), STATE_B(left)) |                                              \
     (STATE_A(below) | pick(main, STATE_B(left), STATE_A(right))) << 2)

kernel void find_midpoint_states(global const uchar *cells, global uchar *states, Layout layout)
{
    const int y = get_global_id(0), across = !(y & 1);
    if (y > layout.side)
        return;
    for (int first = 0; first <= layout.side; first += LANES) {
        const intl x = first + lane_index, odd = (x & 1) == 1, mine = layout.side == 1 ? (intl)0 : across ? odd : !odd;
        intl byte = NOTHING;
        if (first < layout.width && y < layout.height) {
            const intl upper_left = STATE_B(cell_next_to(&layout, cells, x, first, y, -1, -1));
            const intl upper_right = STATE_B(cell_next_to(&layout, cells, x, first, y, 0, -1));
            const intl lower_left = STATE_A(cell_next_to(&layout, cells, x, first, y, -1, 0));
            const intl lower_right = STATE_A(cell_next_to(&layout, cells, x, first, y, 0, 0));
            const intl a = upper_left | (across ? upper_right : lower_left), b = lower_right | (across ? lower_left : upper_right);
            byte = pick(mine, a | b << 2, byte);
        }
        store_bytes(to_ucharl(byte), states + (size_t)y * layout.row + first);
    }
}

kernel void find_center_states(global uchar *states, Layout layout)
{
    const int y = 2 * get_global_id(0) + 1;
    if (y > layout.side || y >= layout.height)
        return;
    global uchar *own = states + (size_t)y * layout.row, *above = own - layout.row, *below = own + layout.row;
    for (int first = 0; first < layout.width; first += LANES) {
        const intl x = first + lane_index, mine = ((x & 1) == 1) & (x < layout.width);
        const intl up = load_bytes(above + first), right = NEXT_TO(load_bytes, own, first, 1);
        const intl down = load_bytes(below + first), left = NEXT_TO(load_bytes, own, first, -1);
        const intl made = CENTER_BYTE(up, right, down, left, IS_MAIN(x, (intl)y, 1));
        store_bytes(to_ucharl(pick(mine, made, load_bytes(own + first))), own + first);
    }
}

/* The row y of vertices of step s > 1 */
void find_row(const Layout *layout, global uchar *states, int s, int y, int centers)
{
    const int side = layout->side, row = layout->row, half_step = s / 2;
    const int across = !(y / s & 1); /* midpoints of this row lie on edges along x */
    for (int x = centers || across ? s : 0; x <= side && x - s < layout->width - 1; x += 2 * s) {
        global uchar *at = states + (size_t)y * row + x;
        if (centers) {
            const int above = at[-s * row], right = at[s], below = at[s * row], left = at[-s];
            *at = CENTER_BYTE(above, right, below, left, IS_MAIN(x, y, s));
            continue;
        }
        const int up = -half_step * row, down = half_step * row;
        const int upper_left = x > 0 && y > 0 ? STATE_B(at[up - half_step]) : 0;
        const int upper_right = x < side && y > 0 ? STATE_B(at[up + half_step]) : 0;
        const int lower_left = x > 0 && y < side ? STATE_A(at[down - half_step]) : 0;
        const int lower_right = x < side && y < side ? STATE_A(at[down + half_step]) : 0;
        const int a = upper_left | (across ? upper_right : lower_left), b = lower_right | (across ? lower_left : upper_right);
        *at = a | b << 2;
    }
}

kernel void find_states(global uchar *states, Layout layout, int s, int centers)
{
    const int y = centers ? s + 2 * s * (int)get_global_id(0) : s * (int)get_global_id(0);
    if (y <= layout.side && y - s < layout.height - 1)
        find_row(&layout, states, s, y, centers);
}

kernel void find_coarse_states(global uchar *states, Layout layout, int finest)
{
    if (get_global_id(0) > 0)
        return;
    for (int s = finest; s < layout.side; s *= 2) {
        for (int y = 0; y <= layout.side && y - s < layout.height - 1; y += s)
            find_row(&layout, states, s, y, 0);
        for (int y = s; y <= layout.side && y - s < layout.height - 1; y += 2 * s)
            find_row(&layout, states, s, y, 1);
    }
}
