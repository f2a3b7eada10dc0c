"""Conversion of recordings to videos."""
