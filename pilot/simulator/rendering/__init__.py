"""What is seen of a track: meshes, textures, light, cameras."""
