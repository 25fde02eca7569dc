/* What nearly every picture of images begins with, as one program: building one takes longer than what is in it. */
#include "lib/clear.cl"
#include "picture/noise.cl"
#include "picture/prepare.cl"
