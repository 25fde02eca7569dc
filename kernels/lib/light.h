/* One light and Lambert's law. */
typedef struct {
    float vector[4]; /* towards the light, unit length (w = 0), or its position (w = 1), in the world */
    float color[3];  /* of what it lights straight on; 1 is white */
    float ambient;   /* part of the light that comes from everywhere, 0 to 1 */
} Light;

/* Cosine of the light's angle to the unit normal (nx, ny, nz) at the point (x, y, z); 0 from behind. */
#define LAMBERT(light, x, y, z, nx, ny, nz, cosine)                                                            \
    {                                                                                                          \
        const floatl to_x = (light).vector[0] - (light).vector[3] * (x);                                       \
        const floatl to_y = (light).vector[1] - (light).vector[3] * (y);                                       \
        const floatl to_z = (light).vector[2] - (light).vector[3] * (z);                                       \
        const floatl far = sqrt(to_x * to_x + to_y * to_y + to_z * to_z);                                      \
        cosine = greater(((nx) * to_x + (ny) * to_y + (nz) * to_z) / far, (floatl)0.0f);                       \
    }
