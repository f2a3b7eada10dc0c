"""A simulator of the simulator: roads, car, cameras and wire of the real one, without Unity, GPU or display."""
