"""Recordings: reading and writing, samples, and batches of augmented frames."""
