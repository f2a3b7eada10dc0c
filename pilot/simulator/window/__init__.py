"""Window of the simulator: display of a drive, and manual driving."""
