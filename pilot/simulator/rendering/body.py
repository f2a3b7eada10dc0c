"""The car's body as a procedural mesh of quads, for views from outside and from the driver's seat.

Car axes: x right, y forward, z up, in metres; the origin is the middle of the rear axle, on the ground.
"""

import math

import numpy as np
from panda3d.core import GeomNode, NodePath, TransparencyAttrib

from pilot.arrays import Floats
from pilot.simulator.course import Colour, Light
from pilot.simulator.rendering.bonnet import PAINT
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.scene import to_geom
from pilot.vehicle import FULL_LOCK, HALF_TRACK, WHEEL_RADIUS, WHEELBASE

WIDTH, SPOKES = 0.24, 5  # of a wheel; metres, number
SIDES = 4 * SPOKES  # of the polygon that approximates a wheel
SUN = np.array([-0.5, -0.4, 0.77])  # towards the light; in car axes, because the shading is computed only once
GLASS, TYRE, RIM, LAMP = (44, 56, 68), (30, 30, 32), (170, 172, 176), (150, 16, 16)
SHADOW = 0.45  # opacity

# Cross-sections from tail to nose: y, half width, lowest and highest z.
# The bonnet's end is where the Unity simulator's centre camera shows it.
Section = tuple[float, float, float, float]
HULL: list[Section] = [
    (-0.92, 0.76, 0.46, 0.72),
    (-0.84, 0.9, 0.34, 0.86),
    (0.9, 0.94, 0.32, 0.9),
    (2.1, 0.94, 0.32, 0.84),
    (3.2, 0.92, 0.34, 0.74),
    (3.66, 0.84, 0.36, 0.64),
    (3.74, 0.7, 0.38, 0.54),
]
CABIN: list[Section] = [
    (-0.5, 0.8, 0.86, 0.88),
    (0.2, 0.64, 0.86, 1.3),
    (1.0, 0.64, 0.86, 1.36),
    (1.55, 0.66, 0.86, 1.3),
    (2.35, 0.82, 0.8, 0.83),
]


class Body:
    """The car's body as a node of the scene graph.

    Attributes:
        root: node to be placed at the car's position.
    """

    def __init__(self, light: Light) -> None:
        self.root = NodePath("car")
        self._light = light
        self._add_shadow()
        self._attach(self.root, *_hull())
        self._attach(self.root, *_cabin())
        lamps = [_card((side - 0.17, -0.93, 0.6), (side + 0.17, -0.93, 0.7)) for side in (-0.56, 0.56)]
        self._lamps = self._attach(self.root, np.concatenate(lamps), [LAMP, LAMP])
        places = [(side * HALF_TRACK, y) for y in (0.0, WHEELBASE) for side in (-1, 1)]
        self._axles = [self._add_wheel(x, y) for x, y in places]

    def show(self, steering: float, travelled: float, *, braking: bool) -> None:
        """Set the wheels and the brake lamps.

        Args:
            steering: -1..1.
            travelled: distance rolled by the wheels, metres.
            braking: whether the brake lamps are on.
        """
        for number, axle in enumerate(self._axles):
            axle.set_h(-math.degrees(steering * FULL_LOCK) if number >= 2 else 0.0)
            axle.get_child(0).set_p(-math.degrees(travelled / WHEEL_RADIUS) % 360)
        self._lamps.set_color_scale(*((1.7, 2.5, 2.5, 1) if braking else (1, 1, 1, 1)))

    def _add_wheel(self, x: float, y: float) -> NodePath:
        axle = self.root.attach_new_node("axle")
        axle.set_pos(x, y, WHEEL_RADIUS)
        self._attach(axle, *_wheel())
        return axle

    def _add_shadow(self) -> None:
        z = 0.06  # metres above the ground, so that an uneven road does not hide the shadow
        corners = np.array([[[-1.1, -1.0, z], [1.1, -1.0, z], [1.1, 3.7, z], [-1.1, 3.7, z]]])
        shadow = self._attach(self.root, corners, [(0, 0, 0)])
        shadow.set_transparency(TransparencyAttrib.M_alpha)
        shadow.set_alpha_scale(SHADOW * self._light.shadows)
        shadow.set_depth_write(False)
        shadow.set_bin("unsorted", 0)  # drawn after the road

    def _attach(self, parent: NodePath, corners: Floats, colours: list[Colour]) -> NodePath:
        """Add quads (n x 4 x 3, metres), each with a colour (RGB, 0..255) that is shaded by its orientation."""
        across, along = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
        normals = np.cross(across, along)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        shine = np.array(self._light.ambient) + np.array(self._light.sun) * (normals @ SUN).clip(0)[:, None]
        lit = np.repeat((np.array(colours) * shine)[:, None], 4, axis=1)
        node = GeomNode("quads")
        node.add_geom(to_geom(Mesh("", corners, lit, np.zeros((*corners.shape[:2], 2))), None))
        return parent.attach_new_node(node)


def _hull() -> tuple[Floats, list[Colour]]:
    corners = _loft(HULL, HULL)
    return corners, [PAINT] * len(corners)


def _cabin() -> tuple[Floats, list[Colour]]:
    wide = [(y, 0.86, low, high) for y, _, low, high in CABIN]
    pieces = len(CABIN) - 1
    top: list[Colour] = [GLASS, PAINT, PAINT, GLASS]  # rear window, roof, windscreen
    corners = _loft(CABIN, wide)[: 3 * pieces]  # without tail and nose, which lie inside the hull
    return corners, [*top, *[GLASS] * (2 * pieces)]


def _loft(upper: list[Section], lower: list[Section]) -> Floats:
    """Return the quads between cross-sections: top, left, right, tail, nose; `lower` gives the lower edges."""
    above = [[(-width, y, high), (width, y, high)] for y, width, _, high in upper]
    below = [[(-width, y, low), (width, y, low)] for y, width, low, _ in lower]
    pairs = range(len(upper) - 1)
    top = [[above[i][0], above[i][1], above[i + 1][1], above[i + 1][0]] for i in pairs]
    left = [[below[i + 1][0], below[i][0], above[i][0], above[i + 1][0]] for i in pairs]
    right = [[below[i][1], below[i + 1][1], above[i + 1][1], above[i][1]] for i in pairs]
    tail = [below[0][0], below[0][1], above[0][1], above[0][0]]
    nose = [below[-1][1], below[-1][0], above[-1][0], above[-1][1]]
    return np.array([*top, *left, *right, tail, nose], float)


def _card(low: tuple[float, float, float], high: tuple[float, float, float]) -> Floats:
    """Return an upright quad (1 x 4 x 3) that faces backwards, from its lower left and upper right corners."""
    return np.array([[low, (high[0], low[1], low[2]), high, (low[0], low[1], high[2])]], float)


def _wheel() -> tuple[Floats, list[Colour]]:
    """Return the quads and colours of a wheel: tread, and both faces with spokes, which make its rotation visible."""
    angles = np.linspace(0, 2 * np.pi, SIDES + 1)
    ring = np.column_stack([np.zeros(SIDES + 1), np.cos(angles), np.sin(angles)])
    right = np.array([WIDTH / 2, 0, 0])
    tread = np.stack(
        [
            WHEEL_RADIUS * ring[:-1] - right,
            WHEEL_RADIUS * ring[1:] - right,
            WHEEL_RADIUS * ring[1:] + right,
            WHEEL_RADIUS * ring[:-1] + right,
        ],
        axis=1,
    )
    bands = [(WHEEL_RADIUS, 0.66 * WHEEL_RADIUS), (0.66 * WHEEL_RADIUS, 0.0)]
    faces = [side for outer, inner in bands for side in _faces(ring, right, outer, inner)]
    spokes: list[Colour] = [RIM if number % 4 < 2 else TYRE for number in range(SIDES)]
    return np.concatenate([tread, *faces]), [*[TYRE] * (3 * SIDES), *spokes, *spokes]


def _faces(ring: Floats, right: Floats, outer: float, inner: float) -> tuple[Floats, Floats]:
    """Return the quads between two radii (metres) of the right and of the left face."""
    band = np.stack([inner * ring[:-1], outer * ring[:-1], outer * ring[1:], inner * ring[1:]], axis=1)
    return band + right, band[:, ::-1] - right
