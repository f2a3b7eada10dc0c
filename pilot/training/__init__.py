"""Training of a model on samples, and its validation."""
