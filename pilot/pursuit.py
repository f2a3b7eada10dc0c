"""How a driver returns to his path: the law of the built-in expert, and of the labels of displaced views.

Pure pursuit (R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992, CMU-RI-TR-92-01) of a
point that lies not on the path but part of the way back to it, so that returns are gentle.
Units are metres, radians and 1/m; positive to the right.
"""

import math

import numpy as np

from pilot.arrays import Floats

LOOKAHEAD = 7.0  # from the rear axle; the bonnet hides nearer points, a more distant one cuts the inner edge of bends
RETURN = 10.0  # distance within which an offset from the path decays to 1/e
OFFSET_LEFT = math.exp(-LOOKAHEAD / RETURN)  # share of an offset from the path that is left at the point to steer for


def returning_curvature(curvature: float | Floats, offset: float | Floats, heading: float | Floats) -> Floats:
    """Return the curvature that returns to a path of a curvature, from an offset and a heading relative to it."""
    return np.asarray(curvature - 2 * (offset * (1 - OFFSET_LEFT) + LOOKAHEAD * heading) / LOOKAHEAD**2)
