"""How a driver returns to his path: the law of the built-in expert, and of the labels of displaced views.

Pure pursuit (R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992, CMU-RI-TR-92-01) of a
point that lies not on the path but part of the way back to it, so that returns are gentle where the road allows it.
Units are metres, radians and 1/m; positive to the right.
"""

import numpy as np

from pilot.arrays import Floats

LOOKAHEAD, SHORTEST_LOOKAHEAD = 10.0, 6.0  # from the rear axle; the bonnet hides nearer points
LOOKAHEAD_PER_RADIUS = 0.3  # in tight bends, whose inner edge a longer lookahead cuts
RETURN, SHORTEST_RETURN = 6.0, 4.0  # distance within which an offset from the path decays to 1/e
RETURN_PER_RADIUS = 0.4  # in tight bends, which leave no room


def lookahead(curvature: float | Floats) -> Floats:
    """Return the distance to the point to steer for, in a bend of a curvature."""
    return np.minimum(np.maximum(LOOKAHEAD_PER_RADIUS / _size(curvature), SHORTEST_LOOKAHEAD), LOOKAHEAD)


def offset_left(curvature: float | Floats) -> Floats:
    """Return the share (0..1) of an offset from the path that is left at the point to steer for."""
    within = np.minimum(np.maximum(RETURN_PER_RADIUS / _size(curvature), SHORTEST_RETURN), RETURN)
    return np.asarray(np.exp(-lookahead(curvature) / within))


def returning_curvature(curvature: float | Floats, offset: float | Floats, heading: float | Floats) -> Floats:
    """Return the curvature that returns to a path of a curvature, from an offset and a heading relative to it."""
    ahead = lookahead(curvature)
    return np.asarray(curvature - 2 * (offset * (1 - offset_left(curvature)) + ahead * heading) / ahead**2)


def _size(curvature: float | Floats) -> Floats:
    return np.maximum(np.abs(curvature), 1e-6)
