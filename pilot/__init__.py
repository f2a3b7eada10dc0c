"""Behavioral cloning for the Udacity simulator: learn to steer from recorded laps, then drive."""
