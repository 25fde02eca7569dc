"""The OpenCL host: which device, which program, how a kernel is launched. Nothing here knows any system."""
