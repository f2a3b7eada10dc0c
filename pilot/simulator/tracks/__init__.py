"""The built-in tracks: each is a file of this folder, named as the track is, with NUMBER and course().

NUMBER is its place in lists; course() makes the road with its surroundings, the same each time.
"""
