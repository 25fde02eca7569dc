/* All that makes a view's mesh, as one program: building one takes longer than what is in it. */
#include "depthmesh/errors.cl"
#include "depthmesh/samples.cl"
#include "depthmesh/select.cl"
#include "depthmesh/smooth.cl"
#include "depthmesh/states.cl"
