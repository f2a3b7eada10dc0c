"""Inspection of recordings: what they contain, and which moments of them are suspicious."""
