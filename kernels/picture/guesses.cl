/* Makes guesses in holes invalid; they keep their colours and depths. valid: (height, width). Work-item: `strip` times
 * LANES pixels of a row. Cost: O(pixels). Determinism: pixels are independent.
 */
#include "lib/lanes.h"
#include "lib/valid.h"

kernel void hide_guesses(global uchar *valid, int width, int height, int strip)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    global uchar *row = valid + (size_t)y * width;
    for (int x = first; x < min(first + strip * LANES, width); x += LANES)
        store_first_bytes((load_first_bytes(row + x, width - x, 0) == SEEN) & 1, row + x, width - x);
}
