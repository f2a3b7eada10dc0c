"""Client side of the Unity simulator's protocol: lets a server drive the simulated car."""
