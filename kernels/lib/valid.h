#ifndef LIB_VALID_H
#define LIB_VALID_H
/* Values of a picture's `valid` while it is drawn: 0 in holes, */
#define SEEN 1
#define GUESSED 3 /* until the picture is finished; odd, so that the lowest bit is 0 in holes alone */
#endif
