"""Procedural textures of surfaces, plants and sky: nothing is downloaded."""

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.simulator.course import Light
from pilot.simulator.rendering.noise import smooth_noise

Picture = NDArray[np.uint8]

SIZE = 256  # pixels; a power of two, as the renderer requires
MEAN = {"asphalt": 0.72, "tarmac": 0.78, "cobbles": 0.7, "concrete": 0.86, "ground": 0.72, "paint": 0.95, "kerb": 1.0}
"""Mean brightness of each surface's texture, by which a mesh's colours are divided to compensate for it."""
RED, WHITE = (214, 98, 90), (238, 232, 220)  # of kerbs


@functools.cache
def surface(name: str) -> Picture:
    """Return a tile (256x256x3) of a surface, a key of MEAN, to be multiplied by a colour; all but kerbs are grey."""
    random = np.random.default_rng([sum(name.encode())])
    if name == "kerb":
        stripes = np.where((np.arange(SIZE) < SIZE // 2)[:, None, None], RED, WHITE)
        return np.asarray(stripes * random.uniform(0.92, 1.0, (SIZE, SIZE, 1)), np.uint8)
    makers = {"asphalt": _asphalt, "tarmac": _tarmac, "cobbles": _cobbles, "concrete": _concrete, "ground": _ground}
    grey = makers.get(name, _paint)(random)
    grey *= MEAN[name] / grey.mean()
    return np.repeat((255 * grey.clip(0, 1)).astype(np.uint8)[:, :, None], 3, axis=2)


def _asphalt(random: np.random.Generator) -> NDArray[np.float64]:
    grains = random.normal(0, 0.46, (SIZE, SIZE))
    stones = (random.uniform(size=(SIZE, SIZE)) > 0.98) * 1.6
    patches = 0.09 * smooth_noise(random, SIZE, SIZE, 12)
    return 0.72 + cv2.GaussianBlur(grains + stones, (0, 0), 1.3) + patches


def _tarmac(random: np.random.Generator) -> NDArray[np.float64]:
    grains = cv2.GaussianBlur(random.normal(0, 0.16, (SIZE, SIZE)), (0, 0), 0.8)
    return 0.78 + grains + 0.07 * smooth_noise(random, SIZE, SIZE, 5)


def _concrete(random: np.random.Generator) -> NDArray[np.float64]:
    return 0.86 + 0.05 * smooth_noise(random, SIZE, SIZE, 10) + random.normal(0, 0.02, (SIZE, SIZE))


def _paint(random: np.random.Generator) -> NDArray[np.float64]:
    return 0.95 + 0.03 * smooth_noise(random, SIZE, SIZE, 10)


def _ground(random: np.random.Generator) -> NDArray[np.float64]:
    blades = cv2.GaussianBlur(random.normal(0, 0.5, (SIZE, SIZE)), (0, 0), 1.2)
    return 0.72 + blades + 0.22 * smooth_noise(random, SIZE, SIZE, 5)


def _cobbles(random: np.random.Generator) -> NDArray[np.float64]:
    """Draw rows of bricks with random brightness."""
    grey = np.full((SIZE, SIZE), 0.4)
    for row in range(8):
        for column in range(-1, 5):
            left, top = column * 64 + 32 * (row % 2), row * 32
            grey[top + 2 : top + 30, max(left + 2, 0) : max(left + 62, 0)] = random.uniform(0.55, 0.9)
    return cv2.GaussianBlur(grey, (0, 0), 1.0) + 0.08 * smooth_noise(random, SIZE, SIZE, 12)


@functools.cache
def plant(kind: str) -> Picture:
    """Return a pine, palm, boulder or bush seen from the side on a transparent background: 128x128x4 RGBA."""
    random = np.random.default_rng([sum(kind.encode())])
    picture = np.zeros((4 * 128, 4 * 128, 4), np.uint8)
    {"pine": _pine, "palm": _palm, "boulder": _boulder, "bush": _bush}[kind](picture, random)
    small = cv2.resize(picture, (128, 128), interpolation=cv2.INTER_AREA)
    seen = small[:, :, 3:4] > 127
    mean = picture[picture[:, :, 3] > 0, :3].mean(0)  # for transparent pixels: interpolation mixes them in at edges
    colours = np.where(small[:, :, 3:4] > 0, small[:, :, :3] * (255 / np.maximum(small[:, :, 3:4], 1)), mean)
    return np.dstack([colours.clip(0, 255).astype(np.uint8), 255 * seen.astype(np.uint8)])


def _pine(picture: Picture, random: np.random.Generator) -> None:
    cv2.rectangle(picture, (248, 200), (264, 511), (92, 72, 52, 255), -1)
    for _ in range(170):
        height = random.uniform(0.02, 0.72)
        reach = 30 + 130 * height**0.7
        at = (int(256 + random.uniform(-reach, reach) * 0.8), int(512 * height))
        shade = random.uniform(0.6, 1.25)
        colour = (int(92 * shade), int(98 * shade), int(52 * shade), 255)
        cv2.ellipse(
            picture,
            at,
            (int(random.uniform(22, 46)), int(random.uniform(8, 18))),
            random.uniform(-20, 20),
            0,
            360,
            colour,
            -1,
        )


def _palm(picture: Picture, random: np.random.Generator) -> None:
    stem = np.array([[250, 150], [262, 260], [256, 380], [248, 511], [268, 511], [276, 380], [278, 260], [264, 150]])
    cv2.fillPoly(picture, [stem], (96, 82, 58, 255))
    for angle in np.linspace(-2.9, -0.2, 11):
        shade = random.uniform(0.7, 1.2)
        length = random.uniform(170, 235)
        steps = np.linspace(0, 1, 12)
        leaf = np.column_stack(
            [256 + length * steps * np.cos(angle), 150 + length * steps * np.sin(angle) * 0.6 + 190 * steps**2.2]
        ).astype(np.int32)
        cv2.polylines(
            picture,
            [leaf],
            isClosed=False,
            color=(int(70 * shade), int(98 * shade), int(40 * shade), 255),
            thickness=26,
        )


def _boulder(picture: Picture, random: np.random.Generator) -> None:
    outline = np.array([[10, 511], [30, 330], [110, 210], [215, 110], [330, 130], [420, 230], [480, 360], [505, 511]])
    cv2.fillPoly(picture, [outline], (140, 132, 122, 255))
    faces = (
        ([[10, 511], [30, 330], [110, 210], [160, 360], [130, 511]], 0.7),
        ([[110, 210], [215, 110], [250, 240], [160, 360]], 1.1),
        ([[330, 130], [420, 230], [480, 360], [505, 511], [360, 511], [300, 320]], 0.82),
    )
    for face, shade in faces:
        cv2.fillPoly(picture, [np.array(face)], (int(140 * shade), int(132 * shade), int(122 * shade), 255))
    grain = (1 + 0.18 * smooth_noise(random, 512, 512, 14))[:, :, None]
    picture[:, :, :3] = (picture[:, :, :3] * grain).clip(0, 255)


def _bush(picture: Picture, random: np.random.Generator) -> None:
    for _ in range(60):
        across, up = random.uniform(60, 452), random.uniform(150, 480)
        shade = random.uniform(0.4, 1.3)
        size = (int(random.uniform(24, 60)), int(random.uniform(20, 44)))
        colour = (int(46 * shade), int(48 * shade), int(26 * shade), 255)
        cv2.ellipse(picture, (int(across), int(up)), size, 0, 0, 360, colour, -1)


def panorama(light: Light, land: tuple[int, int, int], seed: int) -> Picture:
    """Return a panorama of sky and hazy hills, 256x1024x3 RGB; its lowest quarter is below the horizon."""
    random = np.random.default_rng([seed, 2])
    rows = np.linspace(1, -1 / 3, 256)[:, None, None].clip(0, 1) ** 0.6  # 1 at the top, 0 at the horizon
    sky = np.array(light.horizon) + (np.array(light.sky) - np.array(light.horizon, float)) * rows
    picture = np.repeat(sky, 1024, axis=1)
    clouds = (smooth_noise(random, 256, 1024, 7, 5) - 0.25).clip(0, 0.5) * (1 - np.abs(rows[:, :, 0] - 0.5)).clip(0, 1)
    picture += (250 - picture) * clouds[:, :, None]
    for distance in (3, 2, 1):  # from far to near, with decreasing haze
        ridge = 192 - 22 / distance**0.3 * (1.1 + smooth_noise(random, 1, 1024, 6 * distance, 5)[0])
        below = np.arange(256)[:, None] > ridge
        dim = np.array(land) * (np.array(light.sun) * 0.6 + np.array(light.ambient))
        far = dim + (np.array(light.horizon) - dim) * (0.2 + 0.18 * distance)
        picture[below] = far
    grain = 1 + 0.05 * random.normal(size=(256, 1024, 1)) * (np.arange(256)[:, None, None] > 165)
    return (picture * grain).clip(0, 255).astype(np.uint8)
