"""Behavioral cloning for the Udacity simulator: train a network on recorded laps, then let it drive."""
