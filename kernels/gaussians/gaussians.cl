/* All kernels that draw Gaussians. They form one program, because each build of a program has a high fixed cost. */
#include "gaussians/project.cl"
#include "gaussians/sort.cl"
#include "gaussians/blend.cl"
