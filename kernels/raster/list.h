/* The loop of raster/region.h: to be included after the fragment program. */
void draw_list(const Context *context, Region *region, global const int *list, int first, int last, int x, int y)
{
    for (int i = first; i < last; i++) {
        Primitive primitive;
        if (!set_up(context, list[i], x, y, &primitive))
            continue;
        for (int row = primitive.low_y / BLOCK; row <= primitive.high_y / BLOCK; row++)
            for (int column = primitive.low_x / BLOCK; column <= primitive.high_x / BLOCK; column++)
                cover(context, &primitive, region, row * ROW + column, column * BLOCK, row * BLOCK);
    }
}
