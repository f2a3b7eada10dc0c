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


def returning_curvature(
    curvature: float | Floats,
    offset: float | Floats,
    heading: float | Floats,
    lookahead: float | Floats = LOOKAHEAD,
    offset_left: float = OFFSET_LEFT,
) -> Floats:
    """Return the curvature that returns to a path of a curvature, from an offset and a heading relative to it.

    Args:
        curvature: of the path.
        offset, heading: of the car relative to the path.
        lookahead: distance along the path of the point to steer for.
        offset_left: share of the offset that this point still has.
    """
    return np.asarray(curvature - 2 * (offset * (1 - offset_left) + lookahead * heading) / lookahead**2)


def returned(
    offset: float | Floats,
    heading: float | Floats,
    metres: float | Floats,
    lookahead: float | Floats = LOOKAHEAD,
    offset_left: float = OFFSET_LEFT,
) -> tuple[Floats, Floats]:
    """Return offset and heading relative to the path after some metres of the return by `returning_curvature`.

    It is a damped oscillation, because the offset's second derivative is the difference of the curvatures. For negative
    `metres`, the car is taken to have come straight.
    """
    metres = np.asarray(metres, float)
    way = np.maximum(metres, 0) / lookahead
    frequency = math.sqrt(1 - 2 * offset_left)
    along = offset + lookahead * heading
    decay, cosine, sine = np.exp(-way), np.cos(frequency * way), np.sin(frequency * way)
    later_offset = decay * (offset * cosine + along * sine / frequency)
    turned = (offset * frequency + along / frequency) * sine / lookahead
    later_heading = decay * (heading * cosine - turned)
    return np.asarray(later_offset + np.minimum(metres, 0) * heading), np.asarray(later_heading)
