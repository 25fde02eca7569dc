/* Triangles that are squeezed, measured: those that reach over the image's last column or row (tree.h).
 *
 * What they are drawn as is not what the tree's halves of them are made of: so their states, and how far they lie off
 * the samples within them, are found from the image itself. Each vertex with such a side gets its state, and
 * the largest distance of samples from the planes of its sides that are drawn in full.
 *
 * nearness, placed, cells: samples.cl. vertices: (count,) numbers of theirs, y row + x. part_errors, part_states:
 * (count, 2, PARTS) of each side, from every PARTS-th of its rows. states, tree_states: states.cl. own_errors: (count,) scene units.
 * Work-item: a vertex's rows of one part (`measure_squeezed`); a vertex (`join_squeezed`, `place_squeezed_errors`).
 * Cost: O(samples), as half of each level's triangles along the border lie in the next level's. Determinism: maxima.
 */
#include "depthmesh/tree.h"
#include "depthmesh/within.h"

#define PARTS 16

/* The states of the cells below a row of samples that a triangle reaches into */
int states_in_row(const Layout *layout, global const uchar *cells, const Within *t, int row)
{
    const int2 columns = cells_within(layout, t, row);
    intl found = (intl)0;
    for (int first = columns.x; first <= columns.y; first += LANES) {
        const intl x = first + lane_index, there = x <= columns.y;
        const intl byte = select_lanes(there, load_bytes(cells + (size_t)row * layout->pitch + first), (intl)0);
        /* Most often both halves are alike: then it does not matter which of them is reached. */
        if (!any_lane(there & (STATE_A(byte) != STATE_B(byte)))) {
            found = found | STATE_A(byte);
            continue;
        }
        const intl main = ((x ^ row) & 1) == 0;
        const floatl left = to_floatl(x) + beyond_sample(x, layout->width),
                     right = to_floatl(x + 1) + beyond_sample(x + 1, layout->width);
        const floatl top = place_of(row, layout->height), bottom = place_of(row + 1, layout->height);
        /* The diagonal, from left to right, and the upper and the lower half's own corner */
        const floatl start_y = select_lanes(main, top, bottom), end_y = select_lanes(main, bottom, top);
        for (int lower = 0; lower < 2; lower++) {
            const floatl own_x = select_lanes(lower ? main : !main, left, right);
            const floatl px[3] = {left, right, own_x}, py[3] = {start_y, end_y, lower ? bottom : top};
            const intl state = lower ? STATE_B(byte) : STATE_A(byte);
            const intl within = there & overlaps(t, px, py, right - left, end_y - start_y, 2);
            found = found | select_lanes(within, state, (intl)0);
        }
    }
    int states = 0;
    for (int lane = 0; lane < LANES; lane++)
        states |= int_lane(found, lane);
    return states;
}

/* The largest distance of a row's samples within a triangle from its plane: through a corner, with a unit normal */
float error_in_row(const Layout *layout, global const float *nearness, const Within *t, int row, Vector corner,
                   Vector normal)
{
    const int2 columns = columns_within(t, row);
    floatl most = 0.0f;
    for (int first = columns.x; first <= columns.y; first += LANES) {
        const intl x = first + lane_index;
        const floatl n = load_lanes(nearness + (size_t)row * layout->pitch + first);
        const Vector p = point_of(layout, to_floatl(x), (floatl)row, DEPTH_OF(layout->perspective, n));
        const Vector away = minus(p, corner);
        const floatl off = fabs(DOT(away, normal));
        most = select_lanes((x <= columns.y) & IS_SAMPLE(n) & (off > most), off, most);
    }
    return -least_lane(-most);
}

/* The largest distance of the samples of every PARTS-th row within a triangle from its plane; 0, if it is rounding's */
float error_of_part(const Layout *layout, global const float *nearness, const Within *t, int part)
{
    Vector p[3];
    for (int k = 0; k < 3; k++)
        p[k] = point_of(layout, (floatl)t->at[k].x, (floatl)t->at[k].y, DEPTH_OF(layout->perspective, (floatl)t->n[k]));
    const floatl depths = fabs(p[0].z) + fabs(p[1].z) + fabs(p[2].z);
    const float rounding = 2.0f * ROUNDING * float_lane(depths, 0); /* twice, since corners lie beyond samples */
    Vector normal = cross_product(minus(p[0], p[1]), minus(p[2], p[1]));
    const floatl scale = 1.0f / sqrt(DOT(normal, normal));
    normal.x *= scale;
    normal.y *= scale;
    normal.z *= scale;
    float error = 0.0f;
    for (int row = t->low.y + part; row <= t->high.y; row += PARTS)
        error = fmax(error, error_in_row(layout, nearness, t, row, p[1], normal));
    return error > rounding ? error : 0.0f;
}

kernel void measure_squeezed(global const float *nearness, global const float *placed, global const uchar *cells,
                             global const uchar *tree_states, global const int *vertices, int count,
                             global float *part_errors, global uchar *part_states, Layout layout)
{
    const int number = get_global_id(0), part = get_global_id(1);
    if (number >= count || part >= PARTS)
        return;
    const int y = vertices[number] / layout.row, x = vertices[number] - y * layout.row, s = step_of(x, y);
    for (int b = 0; b < 2; b++) {
        Within t;
        float error = 0.0f;
        int states = 0;
        if (part <= 2 * s && triangle_within(&layout, placed, x, y, s, b, &t)) {
            for (int row = t.low.y + part; t.squeezed && row < t.high.y && states != (UNDRAWN | DRAWN); row += PARTS)
                states |= states_in_row(&layout, cells, &t, row);
            const int byte = tree_states[vertices[number]], known = b ? STATE_B(byte) : STATE_A(byte);
            const int state = t.squeezed ? (states ? states : DRAWN) : known;
            if (state == DRAWN) /* errors count of what is drawn in full */
                error = error_of_part(&layout, nearness, &t, part);
        }
        part_errors[(2 * number + b) * PARTS + part] = error;
        part_states[(2 * number + b) * PARTS + part] = states;
    }
}

kernel void join_squeezed(global const int *vertices, int count, global const float *part_errors,
                          global const uchar *part_states, global uchar *states, global float *own_errors)
{
    const int number = get_global_id(0);
    if (number >= count)
        return;
    int byte = 0;
    float own = 0.0f;
    for (int b = 0; b < 2; b++) {
        /* Sides that are not squeezed have their states already. */
        int state = b ? STATE_B(states[vertices[number]]) : STATE_A(states[vertices[number]]);
        int measured = 0;
        float error = 0.0f;
        for (int part = 0; part < PARTS; part++) {
            measured |= part_states[(2 * number + b) * PARTS + part];
            error = fmax(error, part_errors[(2 * number + b) * PARTS + part]);
        }
        state = measured ? measured : state;
        byte |= state << b * SIDE_BITS;
        own = state == DRAWN ? fmax(own, error) : own;
    }
    states[vertices[number]] = byte;
    own_errors[number] = own;
}

kernel void place_squeezed_errors(global const int *vertices, int count, global const float *own_errors,
                                  global float *errors)
{
    const int number = get_global_id(0);
    if (number < count)
        errors[vertices[number]] = own_errors[number];
}
