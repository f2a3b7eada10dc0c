"""Rendering of courses: meshes, textures, light and cameras."""
