"""From a recorded drive to a video."""
