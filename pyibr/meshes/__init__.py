"""Triangle meshes, and their textures, heights and normals."""
