"""The built-in tracks: one module per track, whose name is the track's.

Each defines NUMBER, its position in lists, and course(), which creates its course deterministically.
"""
