/* All kernels that make a view's mesh, as one program: starting a build takes longer than compiling a kernel. */
#include "depthmesh/errors.cl"
#include "depthmesh/samples.cl"
#include "depthmesh/select.cl"
#include "depthmesh/smooth.cl"
#include "depthmesh/states.cl"
