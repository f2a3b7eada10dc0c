"""Driving by hand in a window."""
