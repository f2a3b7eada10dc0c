"""Precomputed light and shadows on the ground; the renderer multiplies the ground's colours by them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.simulator.course import Light
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.plants import Plants
from pilot.simulator.rendering.terrain import CELL, Terrain

SIZE = 2048  # pixels per side of the light map
COARSE = 512  # pixels per side for shading by slopes and shadows of hills
CROWN = {"pine": 0.55, "palm": 0.72, "boulder": 0.5, "bush": 0.5}  # height of the crown's middle, relative to the plant
REACH = 60.0  # metres, maximum length of a hill's shadow
MARCH = 1.0  # metres between the points at which the terrain is compared with a sunbeam
PENUMBRA = 0.5  # metres below the edge of a hill's shadow at which it is complete
FRONDS = 9  # of a palm's shadow


@dataclass(frozen=True, eq=False)
class LightMap:
    """Light on the ground as an image seen from above.

    Attributes:
        picture: factors of the ground's colour, 2048 x 2048 x 3, uint8 RGB (255 is 1); rows run from south to north.
        corner: southwestern corner (east, north), metres.
        size: extent (east, north), metres.
    """

    picture: NDArray[np.uint8]
    corner: Floats
    size: Floats

    def texels(self, points: Floats) -> Floats:
        """Return the texture coordinates (... x 2, 0..1) of points (... x 3, metres)."""
        return np.asarray((points[..., :2] - self.corner) / self.size)

    def light_at(self, points: Floats) -> Floats:
        """Return the light (n x 3, RGB, 0..1) at points (n x 3, metres)."""
        pixels = (self.texels(points) * SIZE).astype(int).clip(0, SIZE - 1)
        return np.asarray(self.picture[pixels[:, 1], pixels[:, 0]] / 255.0)


def bake_light(terrain: Terrain, plants: Sequence[Plants], decks: Sequence[Mesh], light: Light) -> LightMap:
    """Compute the light map of a terrain, including the shadows of its hills, plants and bridges."""
    shine = np.asarray(_slopes(terrain, light) * _hill_shadows(terrain, light), np.float32)
    fine = np.asarray(cv2.resize(shine, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR), np.float32)
    shade = np.zeros((SIZE, SIZE), np.uint8)
    _bridge_shadows(shade, terrain, decks, light)
    for group in plants:
        _plant_shadows(shade, terrain, group, light)
    fine *= 1 - light.shadows * cv2.GaussianBlur(shade, (0, 0), 0.7).astype(np.float32) / 255
    colours = [
        cv2.convertScaleAbs(fine, alpha=255 * sun, beta=255 * ambient)
        for sun, ambient in zip(light.sun, light.ambient, strict=True)
    ]
    return LightMap(np.asarray(cv2.merge(colours), np.uint8), terrain.corner, terrain.size)


def light_above_ground(terrain: Terrain, points: Floats, light: Light) -> Floats:
    """Return the light (... x 3, RGB, 0..1) on level surfaces at points (... x 3, metres), with shadows of hills."""
    east, north, up = light.direction
    per_metre = up / math.hypot(east, north)
    direction = np.array([east, north]) / math.hypot(east, north)
    flat = points.reshape(-1, 3)
    hidden = np.zeros(len(flat))
    for distance in np.arange(MARCH, REACH, MARCH):
        heights = terrain.sample(terrain.heights, flat[:, :2] + direction * distance)
        hidden = np.maximum(hidden, heights - flat[:, 2] - distance * per_metre)
    sun = 1 - light.shadows * (hidden / PENUMBRA).clip(0, 1)
    return np.asarray(sun[:, None] * np.array(light.sun) + np.array(light.ambient)).reshape(points.shape)


def _slopes(terrain: Terrain, light: Light) -> Floats:
    """Return the sunlight (512 x 512) on the ground depending on its slope, relative to level ground."""
    east, north, up = light.direction
    heights = cv2.resize(cv2.GaussianBlur(terrain.heights, (0, 0), 0.7), (COARSE, COARSE))
    rows, columns = terrain.heights.shape
    to_north, to_east = np.gradient(heights, CELL * rows / COARSE, CELL * columns / COARSE)
    facing = (up - to_east * east - to_north * north) / np.sqrt(1 + to_east**2 + to_north**2)
    return np.asarray((facing / up).clip(0, 1.25))


def _hill_shadows(terrain: Terrain, light: Light) -> Floats:
    """Return the factor (512 x 512, 0..1) of the sunlight after shadows of hills; 1 is in the sun."""
    east, north, up = light.direction
    heights = cv2.resize(terrain.heights, (COARSE, COARSE)).astype(np.float32)
    hidden = np.zeros((COARSE, COARSE), np.float32)
    per_metre = up / math.hypot(east, north)
    direction = np.array([east, north]) / math.hypot(east, north)
    longest = float(heights.max() - heights.min()) / per_metre
    for distance in np.arange(MARCH, min(REACH, longest), MARCH):
        shift = direction * distance * COARSE / terrain.size
        shifted = cv2.warpAffine(
            heights,
            np.array([[1, 0, -shift[0]], [0, 1, -shift[1]]], np.float32),
            (COARSE, COARSE),
            borderMode=cv2.BORDER_REPLICATE,
        )
        hidden = np.maximum(hidden, shifted - heights - distance * per_metre)
    return np.asarray(1 - light.shadows * (hidden / PENUMBRA).clip(0, 1))


def _bridge_shadows(shade: NDArray[np.uint8], terrain: Terrain, decks: Sequence[Mesh], light: Light) -> None:
    """Draw the shadows of bridges into `shade`: 0 is in the sun, 255 fully shaded."""
    for mesh in decks:
        heights = terrain.sample(terrain.heights, mesh.corners[..., :2].reshape(-1, 2)).reshape(mesh.corners.shape[:2])
        drop = (mesh.corners[..., 2] - heights).clip(0)[..., None]
        pixels = (mesh.corners[..., :2] + _away(light) * drop - terrain.corner) * SIZE / terrain.size
        for quad in pixels.astype(np.int32):
            cv2.fillConvexPoly(shade, quad, 255)


def _away(light: Light) -> Floats:
    """Return the horizontal displacement (east, north) of a shadow per metre of height."""
    east, north, up = light.direction
    return -np.array([east, north]) / up


def _plant_shadows(shade: NDArray[np.uint8], terrain: Terrain, plants: Plants, light: Light) -> None:
    """Draw the plants' shadows, as on level ground, into `shade`."""
    away, crown = _away(light), CROWN[plants.kind]
    scale = SIZE / terrain.size  # pixels per metre
    angle = math.degrees(math.atan2(away[1] * scale[1], away[0] * scale[0]))
    for point, width, height, turn in zip(plants.points, plants.widths, plants.heights, plants.angles, strict=True):
        foot = (point[:2] - terrain.corner) * scale
        tip = foot + away * height * crown * scale
        cv2.line(shade, foot.astype(int).tolist(), tip.astype(int).tolist(), 200, 2)
        if plants.kind == "palm":
            _fronds(shade, tip, 0.5 * width * scale[0], turn)
            continue
        long = np.hypot(*(away * height * (1 - crown) * scale)) + width * 0.25 * scale[0]
        axes = int(long) + 1, int(width * 0.4 * scale[1]) + 1
        cv2.ellipse(shade, tip.astype(int).tolist(), axes, angle, 0, 360, 215, -1)


def _fronds(shade: NDArray[np.uint8], crown: Floats, length: float, turn: float) -> None:
    """Draw the shadow of a palm's crown: narrow leaves around its middle; `length` in pixels."""
    for leaf in range(FRONDS):
        direction = turn + math.tau * leaf / FRONDS
        end = crown + length * np.array([math.cos(direction), math.sin(direction)])
        middle = ((crown + end) / 2).astype(int).tolist()
        cv2.ellipse(shade, middle, (int(length / 2) + 1, 2), math.degrees(direction), 0, 360, 235, -1)
