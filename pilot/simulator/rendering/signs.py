"""Meshes of the boards on posts that stand beside bends and on bridges."""

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import Course, Light
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.textures import MEAN
from pilot.simulator.track import STEP, Track

APART = 4.0  # metres between two posts
BESIDE = 0.5  # metres from the road's edge
POST_WIDTH, HEIGHT = 0.14, 2.3  # metres
BOARD_WIDTH, BOARD_HEIGHT = 0.9, 0.36  # metres
RED, WHITE, POST = np.array([206.0, 70, 66]), np.array([236.0, 236, 232]), np.array([206.0, 208, 210])
BANDS = ((0.0, 0.34, RED), (0.34, 0.66, WHITE), (0.66, 1.0, RED))


def sign_meshes(course: Course, light: Light) -> list[Mesh]:
    """Create the meshes of the posts and boards of a course's sections with signs; they face along the road."""
    shine = np.array(light.ambient) + 0.8 * np.array(light.sun)
    meshes = []
    for section in course.roadside:
        if section.kind == "signs":
            for side in (-1, 1) if section.side == 0 else (section.side,):
                for progress in np.arange(section.start, section.end, APART):
                    meshes += _sign(course.track, int(progress / STEP), side, shine)
    return meshes


def _sign(track: Track, index: int, side: int, shine: Floats) -> list[Mesh]:
    heading = track.headings[index]
    right, ahead = np.array([np.cos(heading), -np.sin(heading), 0]), np.array([np.sin(heading), np.cos(heading), 0])
    foot = track.points[index] + side * (track.half_widths[index] + BESIDE) * right
    low, high = HEIGHT - BOARD_HEIGHT, HEIGHT
    board = [
        _upright(foot, right * BOARD_WIDTH, (low + first * BOARD_HEIGHT, low + last * BOARD_HEIGHT), colour * shine)
        for first, last, colour in BANDS
    ]
    post = [_upright(foot, way * POST_WIDTH, (-1.0, high), POST * shine) for way in (right, ahead)]
    return [*board, *post]


def _upright(foot: Floats, across: Floats, heights: tuple[float, float], colour: Floats) -> Mesh:
    """Return an upright quad around a vertical line, from `heights` above its foot; measures in metres."""
    low, high = (np.array([0, 0, height]) for height in heights)
    left, right = foot - across / 2, foot + across / 2
    corners = np.array([[left + low, right + low, right + high, left + high]])
    colours = np.broadcast_to(colour / MEAN["paint"], (1, 4, 3))
    return Mesh("paint", corners, colours, np.zeros((1, 4, 2)))
