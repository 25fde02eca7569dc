"""Triangle meshes and what lies on them: textures, heights, tangents."""
