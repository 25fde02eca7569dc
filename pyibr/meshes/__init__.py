"""Triangle meshes, and their textures, heights and tangents."""
