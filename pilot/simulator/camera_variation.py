"""Random variation of the cameras, so that a network does not depend on one exact mounting, exposure or compression."""

import math
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Frame
from pilot.data.frames import QUALITY

HEIGHT = 0.05  # metres, standard deviation
PITCH, ROLL = math.radians(0.5), math.radians(0.5)  # standard deviations; a car on springs leans in bends, too
EXPOSURE = 0.12  # standard deviation of the logarithm of the brightness factor
TINT = 0.03  # standard deviation of the logarithm of each channel's factor
QUALITIES = (55, 95)  # of JPEG


@dataclass(frozen=True)
class CameraVariation:
    """Deviation of the cameras from the standard ones.

    Attributes:
        height: metres above the standard height.
        pitch: radians, positive downwards.
        roll: radians, positive if the camera leans to the right.
        channels: factors of red, green and blue.
        quality: of the JPEG compression.
    """

    height: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    channels: tuple[float, float, float] = (1.0, 1.0, 1.0)
    quality: int = QUALITY

    def developed(self, frame: Frame) -> Frame:
        """Return a frame (160x320x3, uint8 RGB) with its channels multiplied."""
        return np.asarray((frame * np.array(self.channels, np.float32)).clip(0, 255), np.uint8)


STANDARD = CameraVariation()


def draw_variation(random: np.random.Generator) -> CameraVariation:
    """Draw a variation."""
    red, green, blue = np.exp(random.normal(0, EXPOSURE) + random.normal(0, TINT, 3)).tolist()
    return CameraVariation(
        float(random.normal(0, HEIGHT)),
        float(random.normal(0, PITCH)),
        float(random.normal(0, ROLL)),
        (red, green, blue),
        int(random.integers(*QUALITIES)),
    )
