#ifndef WARP_CLASSES_H
#define WARP_CLASSES_H
/* What a pixel of the target is. Of several views' classes of a hole the least counts. */
#define CLASS_SEEN 0
#define CLASS_HIDDEN 1     /* by something nearer */
#define CLASS_UNOBSERVED 2 /* no depth there */
#define CLASS_OUTSIDE 3    /* of the source's image */
#endif
