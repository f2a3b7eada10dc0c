"""How well a model drives: in the built-in simulator, and on recordings."""
