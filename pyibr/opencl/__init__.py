"""The OpenCL host: devices, programs, memory and launches. It is independent of all systems."""
