"""Recordings: from a driving_log.csv to batches of augmented frames."""
