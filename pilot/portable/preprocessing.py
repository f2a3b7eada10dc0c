"""How a network of another project prepares a frame: a list of steps, described in a small JSON file.

    {
      "steps": [
        {"crop": {"top": 60, "bottom": 25}},
        {"resize": {"height": 66, "width": 200}},
        {"colours": "YUV"},
        {"scale": {"divide": 127.5, "subtract": 1}}
      ],
      "layout": "NHWC",
      "steering": {"output": 0, "multiply": 1}
    }

The steps are applied in their order to a frame of 160x320x3, uint8 RGB. They are those of OpenCV, with which nearly all
students' drive.py prepare their frames. Everything may be left out; nothing in the file is executed.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Frame
from pilot.vehicle import COLUMNS, ROWS

Image = NDArray[Any]  # rows x columns x channels, uint8 or float32
Step = Callable[[Image], Image]

INTERPOLATIONS = {
    "nearest": cv2.INTER_NEAREST,
    "linear": cv2.INTER_LINEAR,
    "area": cv2.INTER_AREA,
    "cubic": cv2.INTER_CUBIC,
}
COLOURS = {
    "RGB": None,
    "BGR": cv2.COLOR_RGB2BGR,
    "YUV": cv2.COLOR_RGB2YUV,
    "HSV": cv2.COLOR_RGB2HSV,
    "HLS": cv2.COLOR_RGB2HLS,
    "LAB": cv2.COLOR_RGB2LAB,
    "gray": cv2.COLOR_RGB2GRAY,
}
LAYOUTS = ("NHWC", "NCHW")
LARGEST = 2048  # pixels of a side after resizing


class WrongDescription(ValueError):
    """A description of a network's preprocessing cannot be used; the message says what is wrong and what is valid."""


@dataclass(frozen=True)
class Preprocessing:
    """What a network does with a frame before its first layer, and how its output is read.

    Attributes:
        steps: descriptions of the steps, each a dictionary with one entry.
        layout: of the network's input: NHWC (Keras) or NCHW (PyTorch).
        output: number of the output that is the steering, if there are several.
        multiply: factor from the output to steering of -1..1, right positive: 0.04 for degrees, 1 / 25.
        lambdas: for Keras files: what its Lambda layers, which are never executed, compute: a step by layer name.
    """

    steps: tuple[dict[str, Any], ...] = ()
    layout: str = "NHWC"
    output: int = 0
    multiply: float = 1.0
    lambdas: Mapping[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_functions", tuple(_step(step) for step in self.steps))

    def prepare(self, frame: Frame) -> NDArray[np.float32]:
        """Prepare a frame (160x320x3, uint8 RGB) as the network's input: float32 in the order of `layout`, N = 1."""
        image: Image = frame
        for function in self._functions:  # type: ignore[attr-defined]
            image = function(image)
        image = image.reshape(*image.shape[:2], -1).astype(np.float32, copy=False)
        image = image.transpose(2, 0, 1) if self.layout == "NCHW" else image
        return np.ascontiguousarray(image[None])

    def to_json(self) -> dict[str, Any]:
        """Return the content of a description file."""
        return {
            "steps": list(self.steps),
            "layout": self.layout,
            "steering": {"output": self.output, "multiply": self.multiply},
            "lambdas": dict(self.lambdas),
        }


def read_preprocessing(path: Path) -> Preprocessing:
    """Read a description file.

    Raises:
        WrongDescription: the file is missing, not JSON, or describes something that does not exist.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise WrongDescription(f"{path}: no readable JSON file ({error})") from error
    try:
        return preprocessing_from(content)
    except WrongDescription as error:
        raise WrongDescription(f"{path}: {error}") from error


def preprocessing_from(content: Any) -> Preprocessing:
    """Return the preprocessing with the content of a description file.

    Raises:
        WrongDescription: the content describes something that does not exist.
    """
    content = _entries(content, {"steps", "layout", "steering", "lambdas"}, "the description")
    steering = _entries(content.get("steering", {}), {"output", "multiply"}, "steering")
    steps, lambdas = content.get("steps", []), content.get("lambdas", {})
    if not isinstance(steps, list) or not isinstance(lambdas, dict):
        raise WrongDescription("steps must be a list, and lambdas a dictionary by layer name")
    if content.get("layout", "NHWC") not in LAYOUTS:
        raise WrongDescription(f"layout {content['layout']!r}: must be one of {', '.join(LAYOUTS)}")
    return Preprocessing(
        tuple(steps),
        content.get("layout", "NHWC"),
        int(_number(steering.get("output", 0), "steering output", 0, 99)),
        _number(steering.get("multiply", 1.0), "steering multiply"),
        lambdas,
    )


def is_step(description: Any) -> bool:
    """Return whether something is a dictionary with the name of a step and its values."""
    return isinstance(description, dict) and len(description) == 1 and set(description) <= set(STEPS)


# Steps


def _step(description: Any) -> Step:
    if not is_step(description):
        raise WrongDescription(
            f"step {description!r}: must have one entry, of {', '.join(sorted(STEPS))}; "
            'for example {"crop": {"top": 60, "bottom": 25}}'
        )
    ((name, values),) = description.items()
    return STEPS[name](values)


def _crop(values: Any) -> Step:
    sides = _entries(values, {"top", "bottom", "left", "right"}, "crop")
    top, bottom, left, right = (
        int(_number(sides.get(side, 0), f"crop {side}", 0, LARGEST)) for side in ("top", "bottom", "left", "right")
    )

    def crop(image: Image) -> Image:
        rows, columns = image.shape[:2]
        cropped = image[top : rows - bottom, left : columns - right]
        if not cropped.size:
            raise WrongDescription(f"crop {values}: nothing is left of {rows}x{columns} pixels")
        return cropped

    return crop


def _resize(values: Any) -> Step:
    values = _entries(values, {"height", "width", "interpolation"}, "resize")
    height, width = (int(_number(values.get(side), f"resize {side}", 1, LARGEST)) for side in ("height", "width"))
    interpolation = INTERPOLATIONS.get(values.get("interpolation", "linear"))
    if interpolation is None:
        raise WrongDescription(
            f"resize interpolation {values['interpolation']!r}: must be one of {', '.join(INTERPOLATIONS)}"
        )
    return lambda image: cv2.resize(image, (width, height), interpolation=interpolation)


def _colours(value: Any) -> Step:
    if not isinstance(value, str) or value not in COLOURS:
        raise WrongDescription(f"colours {value!r}: must be one of {', '.join(COLOURS)}")
    code = COLOURS[value]
    return lambda image: image if code is None else cv2.cvtColor(image, code)


def _blur(value: Any) -> Step:
    size = int(_number(value, "blur", 1, 31))
    if size % 2 == 0:
        raise WrongDescription(f"blur {value}: must be odd, the size of a Gaussian kernel in pixels")
    return lambda image: cv2.GaussianBlur(image, (size, size), 0)


def _scale(values: Any) -> Step:
    divide, subtract = scale_values(values)
    return lambda image: image.astype(np.float32) / np.float32(divide) - np.float32(subtract)


def _standardise(value: Any) -> Step:
    if value is not True:
        raise WrongDescription(f"standardise {value!r}: must be true")

    def standardise(image: Image) -> Image:
        pixels = image.astype(np.float32)
        least = 1 / np.sqrt(pixels.size)  # as tf.image.per_image_standardization
        standard: Image = (pixels - pixels.mean()) / np.float32(max(float(pixels.std()), float(least)))
        return standard

    return standardise


STEPS: dict[str, Callable[[Any], Step]] = {
    "crop": _crop,
    "resize": _resize,
    "colours": _colours,
    "blur": _blur,
    "scale": _scale,
    "standardise": _standardise,
}


def scale_values(values: Any) -> tuple[float, float]:
    """Return divisor and subtrahend of a scale step: pixel / divide - subtract.

    Raises:
        WrongDescription: a value is not a number, or the divisor is 0.
    """
    values = _entries(values, {"divide", "subtract"}, "scale")
    divide, subtract = (_number(values.get(key, default), f"scale {key}") for key, default in SCALE_DEFAULTS)
    if divide == 0:
        raise WrongDescription("scale divide 0: must not be 0")
    return divide, subtract


SCALE_DEFAULTS = (("divide", 1.0), ("subtract", 0.0))


def _entries(value: Any, known: set[str], where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise WrongDescription(f"{where}: must be a dictionary with {', '.join(sorted(known))}")
    if unknown := set(value) - known:
        raise WrongDescription(f"{where}: no {sorted(unknown)[0]!r}; there are {', '.join(sorted(known))}")
    return value


def _number(value: Any, what: str, least: float = -1e6, most: float = 1e6) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise WrongDescription(f"{what} {value!r}: must be a number in {least:g}..{most:g}")
    return float(value)


def input_shape(preprocessing: Preprocessing) -> tuple[int, ...]:
    """Prepare a black frame, and return the shape of the network's input.

    Raises:
        WrongDescription: a step cannot be applied to what the step before it gives.
    """
    try:
        return preprocessing.prepare(np.zeros((ROWS, COLUMNS, 3), np.uint8)).shape
    except cv2.error as error:
        raise WrongDescription("a step cannot be applied to the result of the one before, ") from error
