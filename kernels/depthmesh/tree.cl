/* All kernels that make a view's mesh. They are one program, because each build of a program has a high fixed cost. */
#include "depthmesh/errors.cl"
#include "depthmesh/samples.cl"
#include "depthmesh/select.cl"
#include "depthmesh/smooth.cl"
#include "depthmesh/states.cl"
