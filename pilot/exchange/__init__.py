"""Recordings in the formats of other projects."""
