/* Computes a lens's picture from the pictures on a cube's faces, or from one pinhole picture: each pixel reads the
 * place where its ray hits a face.
 *
 * If the four face pixels around this place show one surface, nearness (which is affine on a plane) and colour are
 * interpolated. At the edges of surfaces, next to holes, and if `linear` is 0, both are taken from the nearest face
 * pixel. Four pixels show one surface if none is empty, and if the nearness of each two neighbours differs little, or
 * as much as that of the next two in their row or column: so even steep slopes are not edges. With `filled`, holes are
 * filled; a filled hole only counts as empty if the nearest face pixel is valid. places: (3, height, pitch) u and v in
 * the face, NaN if the pixel's ray hits another face; and the depth in the lens's frame, divided by that in the face's
 * frame. face_depth, face_color, face_valid: (face_height, face_width); depth is NaN if empty. depth, color, valid:
 * (height, width); pixels of other faces are emptied if this face is the `first`, else unchanged. With ORIGINS, CLASSES
 * or GUESSES, the origins, classes or guesses are copied, too; pixels without a ray get the class `unseen`. With ALPHA,
 * opacities are read as colours are; both are also interpolated where an opacity is neither 0 nor 1. Pixels without a
 * ray show the background (red, green, blue). Work-item: STRIP * LANES pixels of a row. Cost: O(pixels). Determinism:
 * pixels are independent.
 */
#include "lib/color.h"
#include "lib/surface.h"
#include "lib/taps.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: pixels' origins are copied, too: the view `source_view`, and the place `source` in it */
#endif
#ifndef CLASSES
#define CLASSES 0 /* 1: classes of pixels are copied, too */
#endif
#ifndef GUESSES
#define GUESSES 0 /* 1: depths of guessed surface, `guesses`, are copied, too */
#endif
#ifndef ALPHA
#define ALPHA 0 /* 1: opacities, `alpha`, are read, too */
#endif
#if ALPHA
#define FACE_ALPHA face_alpha
#else
#define FACE_ALPHA 0
#endif

typedef struct {
    global const float *depth;
    global const channel *color;
    global const uchar *valid;
    global const float *alpha;
    int width, height;
} Face;

typedef struct {
    intl own;         /* mask: the pixel's ray hits this face */
    intl x, y, whole; /* the first of the four pixels around the place; mask: the four show one surface */
    intl nearest;     /* index of the nearest pixel */
    intl mixed;       /* mask: colour and opacity are interpolated */
    floatl weights[4], z, alpha;
    Color color;
} Reading;

/* The nearness of face pixels; NaN if they are empty or outside of the face and, for lanes in the mask `seen`, in
 * filled holes. */
INLINED floatl face_nearness(Face face, intl seen, intl column, intl row)
{
    intl known = (column >= 0) & (column < face.width) & (row >= 0) & (row < face.height);
    const intl at = select_lanes(known, row * face.width + column, (intl)0);
    if (any_lane(seen))
        known = known & (!seen | (to_intl((WIDE(uchar))(gather(face.valid, at))) != 0));
    return select_lanes(known, 1.0f / (floatl)(gather(face.depth, at)), (floatl)NAN);
}

/* Tells whether the nearness changes from b to c by little, or by as much as from a to b, or as from c to d. False for
 * NaN. */
INLINED intl is_on_slope(floatl a, floatl b, floatl c, floatl d)
{
    const floatl step = c - b, small = ONE_SURFACE * min_lanes(b, c);
    return (fabs(step) <= small) | (fabs(b - a - step) <= small) | (fabs(d - c - step) <= small);
}

/* Reads the opacities. Where one of the four is neither 0 nor 1, colour and opacity are interpolated. */
INLINED void read_alpha(Reading *read, Face face, intl linear)
{
    const intl there = (read->x >= 0) & (read->x + 1 < face.width) & (read->y >= 0) & (read->y + 1 < face.height);
    intl soft = 0;
    floatl sum = 0.0f;
    for (int i = 0; i < 4; i++) {
        const intl at = (read->y + (i >> 1)) * face.width + read->x + (i & 1);
        const floatl opacity = (floatl)(gather(face.alpha, select_lanes(there, at, read->nearest)));
        soft = soft | ((opacity > 0.0f) & (opacity < 1.0f));
        sum += read->weights[i] * opacity;
    }
    read->mixed = read->whole | (soft & there & read->own & linear);
    read->alpha = select_lanes(read->mixed, sum, (floatl)(gather(face.alpha, read->nearest)));
}

INLINED Reading read_face(Face face, floatl u_own, floatl v_own, floatl deeper, int linear, int filled)
{
    Reading read;
    read.own = u_own == u_own;
    const floatl u = select_lanes(read.own, u_own, (floatl)0.0f), v = select_lanes(read.own, v_own, (floatl)0.0f);
    const floatl left = min_lanes(floor_lanes(u), (floatl)max(face.width - 2, 0));
    const floatl upper = min_lanes(floor_lanes(v), (floatl)max(face.height - 2, 0));
    const floatl fx = u - left, fy = v - upper;
    const intl x = to_intl(left), up = to_intl(upper);
    const intl near_right = fx >= 0.5f, near_below = fy >= 0.5f;
    read.nearest = (up + select_lanes(near_below, (intl)1, (intl)0)) * face.width + x +
                   select_lanes(near_right, (intl)1, (intl)0);
    intl seen = 0;
    if (filled)
        seen = to_intl((WIDE(uchar))(gather(face.valid, read.nearest))) != 0;
    floatl n[4];
    for (int i = 0; i < 4; i++)
        n[i] = face_nearness(face, seen, x + (i & 1), up + (i >> 1));
    const floatl low = min_lanes(min_lanes(n[0], n[1]), min_lanes(n[2], n[3])),
                 high = max_lanes(max_lanes(n[0], n[1]), max_lanes(n[2], n[3]));
    const intl all_there = read.own & isfinite_lanes(n[0] + n[1] + n[2] + n[3]) & (intl)(linear ? -1 : 0);
    read.whole = all_there & (high - low <= ONE_SURFACE * low);
    if (any_lane(all_there & !read.whole)) {
        intl on = all_there;
        for (int i = 0; i < 2; i++) {
            const floatl before = face_nearness(face, seen, x - 1, up + i);
            const floatl after = face_nearness(face, seen, x + 2, up + i);
            on = on & is_on_slope(before, n[2 * i], n[2 * i + 1], after);
            const floatl above = face_nearness(face, seen, x + i, up - 1);
            const floatl under = face_nearness(face, seen, x + i, up + 2);
            on = on & is_on_slope(above, n[i], n[2 + i], under);
        }
        read.whole = read.whole | on;
    }
    tap_weights(fx, fy, read.weights);
    const floatl n_nearest = select_lanes(near_below, select_lanes(near_right, n[3], n[2]),
                                          select_lanes(near_right, n[1], n[0]));
    floatl between = 0.0f;
    for (int i = 0; i < 4; i++)
        between += read.weights[i] * select_lanes(read.whole, n[i], (floatl)0.0f);
    read.z = deeper / select_lanes(read.whole, between, n_nearest);
    read.x = x;
    read.y = up;
    const int count = face.width * face.height;
    read.color = read_color(face.color, read.nearest, count);
    read.mixed = read.whole;
    if (ALPHA)
        read_alpha(&read, face, (intl)(linear ? -1 : 0));
    if (CHANNELS && any_lane(read.mixed)) {
        Color mixed = {0.0f, 0.0f, 0.0f};
        for (int i = 0; i < 4; i++)
            add_color(&mixed, read.weights[i],
                      read_color(face.color, (up + (i >> 1)) * face.width + x + (i & 1), count));
        read.color = select_color(read.mixed, mixed, read.color);
    }
    return read;
}

/* Writes the first `count` of a packet's pixels. Pixels of other faces are emptied if `empties` is 1, and show the
 * colour `around`; else they are unchanged. */
INLINED void write_packet(const Reading *read, Face face, int count, int empties, Color around, global float *depth,
                          global channel *color, global uchar *valid)
{
    const intl own = read->own;
    if (count == LANES && (empties || !any_lane(!own))) {
        const WIDE(uchar) shows = (WIDE(uchar))(gather(face.valid, read->nearest));
        store_lanes(select_lanes(own, read->z, (floatl)NAN), depth);
        store_bytes(to_ucharl(select_lanes(own, to_intl(shows), (intl)0)), valid);
        write_color(color, select_color(own, read->color, around));
        return;
    }
    for (int lane = 0; lane < count; lane++) {
        const int is_own = int_lane(own, lane) != 0;
        if (!is_own && !empties)
            continue;
        depth[lane] = is_own ? float_lane(read->z, lane) : NAN;
        valid[lane] = is_own ? face.valid[int_lane(read->nearest, lane)] : 0;
        const Color made = select_color(own, read->color, around);
        write_pixel(color + CHANNELS * lane, rounded_channel(color_lane(made, lane)));
    }
}

#if ORIGINS
INLINED void copy_origins(const Reading *read, Face face, int count, int empties, global const float *face_source,
                          global const int *face_source_view, global float *source, global int *source_view)
{
    for (int lane = 0; lane < count; lane++) {
        if (!int_lane(read->own, lane)) {
            if (empties) {
                vstore2((float2)(NAN), lane, source);
                source_view[lane] = -1;
            }
            continue;
        }
        const int nearest = int_lane(read->nearest, lane), view = face_source_view[nearest];
        float2 from = vload2(nearest, face_source);
        if (int_lane(read->whole, lane)) {
            const int corner = int_lane(read->y, lane) * face.width + int_lane(read->x, lane);
            float2 sum = 0.0f;
            int same = 1;
            for (int i = 0; i < 4; i++) {
                const int at = corner + (i >> 1) * face.width + (i & 1);
                same = same && face_source_view[at] == view;
                sum += float_lane(read->weights[i], lane) * vload2(at, face_source);
            }
            from = same ? sum : from;
        }
        vstore2(from, lane, source);
        source_view[lane] = view;
    }
}
#endif

#if CLASSES
INLINED void copy_classes(const Reading *read, int count, int empties, global const uchar *face_classes,
                          global uchar *classes, int unseen)
{
    for (int lane = 0; lane < count; lane++) {
        if (int_lane(read->own, lane))
            classes[lane] = face_classes[int_lane(read->nearest, lane)];
        else if (empties)
            classes[lane] = unseen;
    }
}
#endif

#if GUESSES
/* Writes the depth of each pixel that reads a face pixel with guessed surface, NaN for the others. */
INLINED void copy_guesses(const Reading *read, Face face, int count, global const float *face_guesses,
                          global const float *depth, global float *guesses)
{
    for (int lane = 0; lane < count; lane++) {
        if (!int_lane(read->own, lane))
            continue;
        const int whole = int_lane(read->whole, lane);
        const int corner = int_lane(read->y, lane) * face.width + int_lane(read->x, lane);
        const int nearest = int_lane(read->nearest, lane);
        int guessed = 0;
        for (int i = 0; i < (whole ? 4 : 1); i++) {
            const int at = whole ? corner + (i >> 1) * face.width + (i & 1) : nearest;
            guessed |= face_guesses[at] == face.depth[at];
        }
        guesses[lane] = guessed && face.valid[nearest] ? depth[lane] : NAN; /* not in filled holes */
    }
}
#endif

kernel void join_faces(global const float *places, global const float *face_depth, global const channel *face_color,
                       global const uchar *face_valid, int face_width, int face_height, int width, int height,
                       int pitch, int first, int linear, int filled, float red, float green, float blue,
                       global float *depth, global channel *color, global uchar *valid
#if ORIGINS
                       ,
                       global const float *face_source, global const int *face_source_view, global float *source,
                       global int *source_view
#endif
#if CLASSES
                       ,
                       global const uchar *face_classes, global uchar *classes, int unseen
#endif
#if GUESSES
                       ,
                       global const float *face_guesses, global float *guesses
#endif
#if ALPHA
                       ,
                       global const float *face_alpha, global float *alpha
#endif
)
{
    const int y = get_global_id(1);
    if (y >= height)
        return;
    const Face face = {face_depth, face_color, face_valid, FACE_ALPHA, face_width, face_height};
    const Color around = {red, green, blue};
    const size_t plane = (size_t)height * pitch;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < width; x0 += LANES, packet++) {
        global const float *place = places + (size_t)y * pitch + x0;
        const Reading read = read_face(face, load_lanes(place), load_lanes(place + plane),
                                       load_lanes(place + 2 * plane), linear, filled);
        const size_t at = (size_t)y * width + x0;
        const int count = min(LANES, width - x0);
        write_packet(&read, face, count, first, around, depth + at, color + CHANNELS * at, valid + at);
#if ORIGINS
        copy_origins(&read, face, count, first, face_source, face_source_view, source + 2 * at, source_view + at);
#endif
#if CLASSES
        copy_classes(&read, count, first, face_classes, classes + at, unseen);
#endif
#if GUESSES
        copy_guesses(&read, face, count, face_guesses, depth + at, guesses + at);
#endif
#if ALPHA
        const floatl before = first ? 0.0f : load_first(alpha + at, count, 0.0f);
        store_first(select_lanes(read.own, read.alpha, before), alpha + at, count);
#endif
    }
}
