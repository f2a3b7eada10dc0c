"""The networks, their file model.pt, and what they look at."""
