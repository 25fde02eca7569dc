#ifndef WARP_LINES_H
#define WARP_LINES_H
/* Positions of the sweep's lines in the target and in the source. */
#include "warp/cells.h"

#ifndef ALIGNED
#define ALIGNED 0 /* 1: lines along rows or columns of both images, through the pixels' centres */
#endif
#ifndef SEGMENT
#define SEGMENT 0 /* number of a line's pixels that one work-item settles; 0: all of them */
#endif
#ifndef EDGES
#define EDGES 0 /* 1: walk from edge to edge of the triangles, which is exact; 0: from column to column (row to row) */
#endif

/* A group of equally spaced epipolar lines of the target. One axis of the image is called "along", the other "across":
 * each line has one pixel at each coordinate along. */
typedef struct {
    int axis;                    /* the axis along; 0: x, 1: y */
    int side;                    /* side of the epipole: the sign of D (epipolar.cl) along the axis */
    int first_packet;            /* number of the group's first packet of lines */
    int count;                   /* number of lines */
    int low, high;               /* first and last coordinate along */
    int cross_low, cross_high;   /* first and last coordinate across */
    int levels;                  /* how often the distance to the epipole halves within the image */
    float reference;             /* coordinate along at which all lines (of all levels) are 1 pixel apart */
    float first, spacing;        /* at the reference: the first line's coordinate across, and the lines' spacing */
    float distance, distance_step; /* distance + distance_step * along: distance to the epipole, 1 at the reference */
    float least;                   /* no pixel at this distance from the epipole or less belongs to the lines */
} LineGroup;

typedef struct {
    int along, across;             /* axes of the target; 0: x, 1: y */
    floatl start, slope;           /* in the target: across = start + slope * along, */
    floatl low, high;              /* for the coordinates along from low to high */
    intl u_major;                  /* in the source: minor = minor_0 + tilt * major; mask: u is major, else v */
    floatl minor_0, tilt, sign;    /* sign: the walk's direction along the major axis, 1 or -1 */
    floatl from, to, last_major;   /* range of major coordinates to walk, none if from > to; the image's last */
    intl last_minor, stride_major, stride_minor;
    intl first_pixel;              /* ALIGNED: the index of the line's pixel 0 */
} SweepLines;

/* The index of the group that a packet belongs to */
int group_of(global const LineGroup *groups, int count, int packet)
{
    int g = 0;
    while (g + 1 < count && packet >= groups[g + 1].first_packet)
        g++;
    return g;
}

/* The lines of a packet in the target and in the source, clipped to both images */
INLINED SweepLines lines_of(LineGroup group, PixelMap map, int packet)
{
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    SweepLines line;
    line.along = group.axis;
    line.across = 1 - group.axis;
    const float b_along = AXIS_ENTRY(D, line.along, 3), b_across = AXIS_ENTRY(D, line.across, 3), b_w = D[11];
    const float e_u = S[3], e_v = S[7], e_w = S[11];
    const int number = packet - group.first_packet, lines = (group.count + LANES - 1) / LANES;
    const intl index = number % lines * LANES + lane_index;
    const floatl at_reference = group.first + group.spacing * to_floatl(index);
    line.slope = (at_reference * b_w - b_across) / (group.reference * b_w - b_along);
    line.start = at_reference - line.slope * group.reference;
    const floatl steep = select_lanes(fabs(line.slope) < 1e-12f, (floatl)1e-12f, line.slope);
    const floatl cross_0 = (group.cross_low - 0.5f - line.start) / steep,
                 cross_1 = (group.cross_high + 0.5f - line.start) / steep;
    line.low = fmax((floatl)group.low, ceil(fmin(cross_0, cross_1)));
    line.high = fmin((floatl)group.high, floor(fmax(cross_0, cross_1)));
#if SEGMENT
    const float first_pixel = group.low + number / lines * SEGMENT;
    line.low = fmax(line.low, first_pixel);
    line.high = fmin(line.high, first_pixel + (SEGMENT - 1));
#endif
    intl in_area = index < group.count;
#if ALIGNED
    in_area = in_area & (at_reference >= group.cross_low) & (at_reference <= group.cross_high);
    line.first_pixel = to_intl(at_reference) * (group.axis ? 1 : map.dst_pitch);
#endif
    line.low = select_lanes(in_area, line.low, (floatl)0.0f);
    line.high = select_lanes(in_area, line.high, (floatl)-1.0f);

    /* The same lines in the source, directed as the target's rays recede: away from the epipole */
    const int along = line.along;
    const floatl x = along ? at_reference : (floatl)group.reference, y = along ? (floatl)group.reference : at_reference;
    const floatl u0 = PIXEL_ROW(S, 0, x, y), v0 = PIXEL_ROW(S, 1, x, y), w0 = PIXEL_ROW(S, 2, x, y);
    const floatl dir_u = u0 * e_w - e_u * w0, dir_v = v0 * e_w - e_v * w0, offset = e_u * v0 - e_v * u0;
    const intl u_major = fabs(dir_u) >= fabs(dir_v);
    const floatl dir_major = select_lanes(u_major, dir_u, dir_v);
    line.u_major = u_major;
    line.tilt = select_lanes(u_major, dir_v, dir_u) / dir_major;
    line.minor_0 = select_lanes(u_major, -offset, offset) / dir_major;
#if ALIGNED
    const floatl row = floor_lanes(line.minor_0 + 0.5f);
    line.minor_0 = select_lanes(fabs(line.minor_0 - row) < ON_SAMPLES, row, line.minor_0);
#endif
    line.sign = select_lanes(dir_major < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    line.last_major = to_floatl(select_lanes(u_major, (intl)(map.src_width - 1), (intl)(map.src_height - 1)));
    line.last_minor = select_lanes(u_major, (intl)(map.src_height - 1), (intl)(map.src_width - 1));
    line.stride_major = select_lanes(u_major, (intl)1, (intl)map.src_pitch);
    line.stride_minor = select_lanes(u_major, (intl)map.src_pitch, (intl)1);

    /* Clip the source line to the image, and to the part on this side of the epipole. */
    floatl from = -BORDER, to = line.last_major + BORDER;
    const floatl tilted = select_lanes(fabs(line.tilt) < 1e-12f, (floatl)1e-12f, line.tilt);
    const floatl edge_0 = (-BORDER - ON_SAMPLES - line.minor_0) / tilted;
    const floatl edge_1 = (to_floatl(line.last_minor) + BORDER + ON_SAMPLES - line.minor_0) / tilted;
    from = fmax(from, fmin(edge_0, edge_1));
    to = fmin(to, fmax(edge_0, edge_1));
    const floatl e_major = select_lanes(u_major, (floatl)e_u, (floatl)e_v);
    if (e_w != 0.0f) {
        const floatl epipole = e_major / e_w;
        const intl after = e_w * line.sign > 0.0f; /* the part's coordinates are greater than the epipole's */
        from = select_lanes(after, fmax(from, epipole), from);
        to = select_lanes(after, to, fmin(to, epipole));
    }
    /* Rays in the plane through the source's centre, parallel to its image, have no line there: nothing is walked. */
    const intl somewhere = isfinite_lanes(line.tilt) & isfinite_lanes(line.minor_0);
    line.from = select_lanes(somewhere, from, (floatl)0.0f);
    line.to = select_lanes(somewhere, to, (floatl)-1.0f);
    return line;
}

/* The lines of lines_of; in the source, they are also clipped to the part that the range of depth can reach. */
INLINED SweepLines sweep_lines(LineGroup group, PixelMap map, int packet, float nearest, float farthest)
{
    const float *S = map.src_from_dst;
    const float e_w = S[11], e_q = S[15];
    SweepLines line = lines_of(group, map, packet);
    const floatl e_major = select_lanes(line.u_major, (floatl)S[3], (floatl)S[7]);
    floatl reach_low = INFINITY, reach_high = -INFINITY;
    intl bounded = 1;
    for (int corner = 0; corner < 4; corner++) {
        const floatl p = corner & 1 ? line.low - 1.0f : line.high + 1.0f, c = line.start + line.slope * p;
        const float q = corner & 2 ? nearest : farthest;
        const floatl px = line.along ? c : p, py = line.along ? p : c;
        const floatl cu = PIXEL_ROW(S, 0, px, py), cv = PIXEL_ROW(S, 1, px, py), cw = PIXEL_ROW(S, 2, px, py),
                     cq = PIXEL_ROW(S, 3, px, py);
        const floatl whole = cw * e_q - e_w * cq, part = e_q - q * e_w;
        const floatl at = (select_lanes(line.u_major, cu, cv) * part + e_major * (q * cw - cq)) / whole;
        bounded = bounded & (whole * part > 0.0f);
        reach_low = fmin(reach_low, at);
        reach_high = fmax(reach_high, at);
    }
    line.from = select_lanes(bounded, fmax(line.from, reach_low - 1.0f), line.from);
    line.to = select_lanes(bounded, fmin(line.to, reach_high + 1.0f), line.to);
    return line;
}
#endif
