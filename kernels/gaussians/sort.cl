/* Sorts Gaussians by distance: a radix sort, one pass for each digit of the keys, the lowest digit first.
 *
 * `count_digits` counts the digits in each of `chunks` equal parts. raster/bins.cl then replaces each count by the place
 * where the chunk's elements of this digit begin, and `move_by_digit` moves them there, in their order. The first pass
 * (`shift` 0) leaves out elements that are not drawn. Last, `order_boxes` sorts the boxes, for the lists of bins.
 *
 * keys, places: (count,) the elements to sort; in the first pass, elements are numbered and `places` is not read.
 * visible: (DIGITS + 1,) the first pass's starts of digits, whose last value is the number of elements drawn. counts:
 * (chunks, DIGITS). moved_keys, moved_places: (count,) the elements, sorted by one more digit. boxes: raster/boxes.h.
 * ordered: (count, 4) sorted boxes, empty ones at the end. Work-item: a chunk, or `share` boxes. Cost: O(count + chunks
 * * DIGITS). Determinism: the sort is stable, and nothing is atomic.
 */
#include "gaussians/splat.h"

#define DIGITS 2048 /* 11 bits: 3 passes sort the 31 bits of positive floats */
#define DIGIT(key, shift) (((key) >> (shift)) & (DIGITS - 1))

/* The first element of a chunk; that of the next chunk is where this chunk ends. */
int chunk_start(int chunk, int chunks, int elements)
{
    return (int)((long)elements * chunk / chunks);
}

kernel void count_digits(global const uint *keys, global const int *visible, int count, int shift, int chunks,
                         global int *counts)
{
    const int c = get_global_id(0);
    if (c >= chunks)
        return;
    const int elements = shift ? visible[DIGITS] : count, last = chunk_start(c + 1, chunks, elements);
    global int *mine = counts + (size_t)c * DIGITS;
    for (int digit = 0; digit < DIGITS; digit++)
        mine[digit] = 0;
    for (int i = chunk_start(c, chunks, elements); i < last; i++)
        if (keys[i] != NOT_DRAWN)
            mine[DIGIT(keys[i], shift)]++;
}

kernel void move_by_digit(global const uint *keys, global const int *places, global const int *visible, int count,
                          int shift, int chunks, global int *counts, global uint *moved_keys,
                          global int *moved_places)
{
    const int c = get_global_id(0);
    if (c >= chunks)
        return;
    const int elements = shift ? visible[DIGITS] : count, last = chunk_start(c + 1, chunks, elements);
    global int *mine = counts + (size_t)c * DIGITS;
    for (int i = chunk_start(c, chunks, elements); i < last; i++) {
        if (keys[i] == NOT_DRAWN)
            continue;
        const int to = mine[DIGIT(keys[i], shift)]++;
        moved_keys[to] = keys[i];
        moved_places[to] = shift ? places[i] : i;
    }
}

kernel void order_boxes(global const ushort *boxes, global const int *places, global const int *visible, int count,
                        int share, global ushort *ordered)
{
    const int first = get_global_id(0) * share, last = min(first + share, count), shown = visible[DIGITS];
    for (int i = first; i < last; i++)
        vstore4(i < shown ? vload4(places[i], boxes) : (ushort4)(1, 0, 1, 0), i, ordered);
}
