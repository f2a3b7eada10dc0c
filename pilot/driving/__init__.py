"""A model drives the simulator: telemetry in, commands out."""
