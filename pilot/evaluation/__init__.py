"""Evaluation of models: in closed loop in the built-in simulator, and by replays of recordings."""
