"""Roads laid out from pieces: straights, arcs and shifts to the side, each level or a ramp.

A layout is a text such as "5S R20 r+ L10-". Each piece is one of

    S      straight, 10 m
    R20    quarter circle to the right of 20 m radius; L to the left
    R20:60 60 degrees of such a circle
    S25    straight, 25 m
    r, l   shift by 10 m to the right or left within 20 m

optionally preceded by a number of repetitions, and followed by + or - for a ramp that rises or falls by 5 m.
"""

import math
import re
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.track import Track, resampled

FINE = 0.05  # metres between the points that a piece is made of, approximately
STRAIGHT = 10.0  # metres
# A shift is an arc, a straight, and the arc back. Of the curves of 20 m ahead and 10 m aside, this one is no tighter
# than the tightest bends of the Unity simulator's jungle and agrees with what people drove there.
SHIFT_RADIUS, SHIFT_STRAIGHT, SHIFT_TURN = 10.0, 10.0, math.asin(0.6)  # metres, metres, radians
RAMP_RISE = 5.0  # metres
CLOSED = 1.0, math.radians(1.0)  # tolerances of a closed road, metres and radians
PIECE = re.compile(r"(?P<count>\d*)(?P<kind>[SLRlr])(?P<size>[\d.]*)(:(?P<degrees>[\d.]+))?(?P<ramp>[+-]?)")


@dataclass(frozen=True)
class Piece:
    """A piece of road.

    Attributes:
        kind: S straight, L or R arc, l or r shift.
        size: length of a straight or radius of an arc, metres; not used for a shift.
        angle: of an arc, radians; not used otherwise.
        rise: of the road over the piece, metres.
    """

    kind: str
    size: float = STRAIGHT
    angle: float = math.pi / 2
    rise: float = 0.0

    def curve(self) -> Floats:
        """Return the piece as it leaves the origin northwards: x, y, heading, curvature (n x 4).

        Metres, radians and 1/m; the last point is the first one of the next piece.
        """
        side = 1 if self.kind in "rR" else -1
        if self.kind == "S":
            along = np.linspace(0, self.size, _points(self.size))
            return np.column_stack([0 * along, along, 0 * along, 0 * along])
        if self.kind in "LR":
            angles = np.linspace(0, self.angle, _points(self.size * self.angle))
            x, y = side * self.size * (1 - np.cos(angles)), self.size * np.sin(angles)
            return np.column_stack([x, y, side * angles, np.full(len(angles), side / self.size)])
        there, back = (Piece(kind, SHIFT_RADIUS, SHIFT_TURN) for kind in ("RL" if side > 0 else "LR"))
        return lay_out([there, Piece("S", SHIFT_STRAIGHT), back], (0, 0, 0), 0.0)[:, [0, 1, 3, 4]]


def parse_layout(text: str) -> list[Piece]:
    """Convert the text of a layout to its pieces.

    Raises:
        ValueError: a piece is none of those that the module's description names.
    """
    pieces = []
    for word in text.split():
        match = PIECE.fullmatch(word)
        if match is None:
            raise ValueError(f"piece {word!r}: takes [COUNT]S[METRES], L or R with a radius, l or r, each with + or -")
        size = float(match["size"] or STRAIGHT)
        rise = {"+": RAMP_RISE, "-": -RAMP_RISE, "": 0.0}[match["ramp"]]
        piece = Piece(match["kind"], size, math.radians(float(match["degrees"] or 90)), rise)
        pieces += [piece] * int(match["count"] or 1)
    return pieces


def laid_out_road(
    name: str,
    pieces: list[Piece],
    entry: tuple[float, float, float],
    heading: float,
    half_width: float,
    *,
    lane: float = 0.0,
    start: float = 0.0,
) -> Track:
    """Create a track from pieces, which must lead back to where they began.

    Args:
        name: of the track.
        pieces: in the direction of driving.
        entry: where the first piece begins: x, y, z in metres.
        heading: in which the first piece begins, radians.
        half_width: distance from the centre line to the road's edge, metres.
        lane: lateral offset of the middle of the car's lane, metres.
        start: distance from the first piece to the start line, metres.

    Raises:
        ValueError: the road is not closed.
    """
    curve = lay_out(pieces, entry, heading)
    gap, turn = math.dist(curve[-1, :3], entry), (curve[-1, 3] - heading + math.pi) % math.tau - math.pi
    if gap > CLOSED[0] or abs(turn) > CLOSED[1]:
        raise ValueError(f"{name}: the road ends {gap:.1f} m and {math.degrees(turn):.1f} degrees from where it began")
    return resampled(name, curve, half_width, lane=lane, start=start)


def lay_out(pieces: list[Piece], entry: tuple[float, float, float], heading: float) -> Floats:
    """Return the centre line of consecutive pieces: n x 5, x, y, z (metres), heading (radians), curvature (1/m)."""
    position, parts = np.array(entry, float), []
    for piece in pieces:
        curve = piece.curve()
        cosine, sine = math.cos(heading), math.sin(heading)
        x, y = curve[:, 0] * cosine + curve[:, 1] * sine, curve[:, 1] * cosine - curve[:, 0] * sine
        rise = piece.rise * _smooth(np.linspace(0, 1, len(curve)))
        part = np.column_stack([np.column_stack([x, y, rise]) + position, curve[:, 2] + heading, curve[:, 3]])
        parts.append(part[:-1])
        position, heading = part[-1, :3], float(part[-1, 3])
    return np.concatenate([*parts, part[-1:]])


def _points(length: float) -> int:
    return max(math.ceil(length / FINE), 2) + 1


def _smooth(part: Floats) -> Floats:
    """Return the cubic from 0 to 1 that is level at both ends, for parts of 0..1."""
    return np.asarray(part * part * (3 - 2 * part))
