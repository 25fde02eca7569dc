#ifndef WARP_CLASSES_H
#define WARP_CLASSES_H
/* Classes of the target's pixels. If several views give a hole different classes, the least one counts. */
#define CLASS_SEEN 0
#define CLASS_HIDDEN 1     /* hidden by something nearer */
#define CLASS_UNOBSERVED 2 /* the source has no depth there */
#define CLASS_OUTSIDE 3    /* outside of the source's image */
#endif
