"""Networks, the model file model.pt, inference, and saliency."""
