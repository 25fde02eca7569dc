#ifndef LIB_PIXELSPACE_H
#define LIB_PIXELSPACE_H
/* Pixel space: one coordinate system for perspective and orthographic cameras.
 *
 * For a camera, a point has the homogeneous coordinates (U, V, W, Q): its pixel is (U/W, V/W) and its nearness is Q/W,
 * which is 1/z for a perspective camera and -z for an orthographic one. Nearer points have greater nearness with both;
 * W > 0 in front of the camera. Straight lines stay straight, triangles stay planar, and the map from one camera's
 * pixel space to another's is one 4x4 matrix (McMillan's warp equation with depth; Schaufler & Priglinger
 * 1999, equation 2). The matrix's last column is the epipole: the second camera's image of the first camera's centre.
 */
#define NO_SURFACE -1e37f /* nearness of an invalid sample */
#define FREE_RAY -2e37f   /* nearness of a sample whose ray passes through empty space */
#define EMPTY -3e38f      /* nearness of a pixel without a hit */
#define BLOCKED -2e38f    /* nearness of a pixel whose ray meets a side of the surface that is not shown */
#define IS_HIT(nearness) ((nearness) > -1e38f)

typedef struct {
    float dst_from_src[16]; /* row by row */
    float src_from_dst[16];
    int src_width, src_height;
    int src_pitch; /* samples from one row of nearness to the next */
    int dst_width, dst_height;
    int dst_pitch;      /* values from one row of the target's hits to the next */
    int dst_perspective; /* 1: the target's nearness is 1/z; 0: -z */
} PixelMap;

#define NEAREST_DEPTH 1e-37f
#define FARTHEST_DEPTH 1e37f

/* Tells whether a hit lies in front of the target's camera, at a depth within float32's range. (Beyond infinity, at
 * negative nearness, a perspective camera's ray continues behind the camera.) NEAREST_DEPTH is also the nearness of
 * FARTHEST_DEPTH.
 */
#define IS_BEFORE(perspective, nearness)                                                                       \
    (((perspective) ? (nearness) > NEAREST_DEPTH : (nearness) < -NEAREST_DEPTH) & (fabs(nearness) < FARTHEST_DEPTH))

/* The depth (planar z) at a nearness; the same formula gives the nearness at a depth. */
#define DEPTH_OF(perspective, nearness) ((perspective) ? 1.0f / (nearness) : -(nearness))

/* One homogeneous component of the point to which the map m takes pixel (x, y) at nearness 0 */
#define PIXEL_ROW(m, row, x, y) ((m)[4 * (row)] * (x) + (m)[4 * (row) + 1] * (y) + (m)[4 * (row) + 2])

/* The same at nearness n */
#define MAP_ROW(m, row, x, y, n) (PIXEL_ROW(m, row, x, y) + (n) * (m)[4 * (row) + 3])

/* An entry of the map m, in the row of an axis (0: x, 1: y). Bit operations select it: compilers would turn a condition
 * into an index, and an array that is indexed at run time cannot be in registers. */
#define AXIS_ENTRY(m, axis, column)                                                                            \
    as_float((as_int((m)[column]) & ((axis) - 1)) | (as_int((m)[4 + (column)]) & -(axis)))
#endif
