"""How a driver returns to his path: the law of the built-in expert, and of the labels of displaced views.

Pure pursuit (R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992, CMU-RI-TR-92-01) of a
point that lies not on the path but part of the way back to it, so that returns are gentle.
Units are metres, radians and 1/m; positive to the right.
"""

import math
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Floats

LOOKAHEAD = 7.0  # from the rear axle; the bonnet hides nearer points, a more distant one cuts the inner edge of bends
RETURN = 10.0  # distance within which an offset from the path decays to 1/e
OFFSET_LEFT = math.exp(-LOOKAHEAD / RETURN)  # share of an offset from the path that is left at the point to steer for


@dataclass(frozen=True)
class PurePursuit:
    """The law by which a car returns to a path.

    Attributes:
        lookahead: distance along the path of the point to steer for; a number, or an array of n for n cars.
        offset_left: share of the offset from the path that this point still has.
    """

    lookahead: float | Floats = LOOKAHEAD
    offset_left: float = OFFSET_LEFT

    def curvature(self, path: float | Floats, offset: float | Floats, heading: float | Floats) -> Floats:
        """Return the curvature that returns to a path of a curvature, from an offset and a heading relative to it."""
        missing = offset * (1 - self.offset_left) + self.lookahead * heading
        return np.asarray(path - 2 * missing / self.lookahead**2)

    def after(self, metres: float | Floats, offset: float | Floats, heading: float | Floats) -> tuple[Floats, Floats]:
        """Return offset and heading relative to the path after some metres of the return.

        It is a damped oscillation, because the offset's second derivative is the difference of the curvatures. For
        negative `metres`, the car is taken to have come straight.
        """
        metres = np.asarray(metres, float)
        way = np.maximum(metres, 0) / self.lookahead
        frequency = math.sqrt(1 - 2 * self.offset_left)
        along = offset + self.lookahead * heading
        decay, cosine, sine = np.exp(-way), np.cos(frequency * way), np.sin(frequency * way)
        later_offset = decay * (offset * cosine + along * sine / frequency)
        turned = (offset * frequency + along / frequency) * sine / self.lookahead
        later_heading = decay * (heading * cosine - turned)
        return np.asarray(later_offset + np.minimum(metres, 0) * heading), np.asarray(later_heading)


EXPERT = PurePursuit()
