"""From samples to a trained model, and how good it is."""
