"""The augmentations of augment.py for a whole batch at once, on the network's device.

A GPU computes a step in a hundredth of the time of a CPU, so augmentation with OpenCV could not keep up. The parameters
are still drawn on the CPU, so that both paths give the same images. They differ by up to two grey levels, because
OpenCV rounds its interpolation coefficients.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pilot.arrays import Floats, Matrix
from pilot.data.augment_batch import photometric_columns
from pilot.data.view import from_rows
from pilot.vehicle import COLUMNS, ROWS


@dataclass(frozen=True)
class DrawnAugmentations:
    """Drawn augmentations of n frames.

    Attributes:
        homographies: n x 3 x 3, float32: inverse homographies, from pixels of the rows that the network uses to
            pixels of the rows that the cache stores.
        photometric: n x the joined parameters from `draw_photometric`, float32.
    """

    homographies: Tensor
    photometric: Tensor

    @classmethod
    def of(
        cls, homographies: Matrix, photometric: Sequence[Floats], first_cached: int, first_used: int
    ) -> "DrawnAugmentations":
        """Convert augmentations drawn for whole frames.

        Args:
            homographies: n x 3 x 3, from the recorded frame's pixels to those of the view.
            photometric: parameters from `draw_photometric`; empty: none.
            first_cached: first frame row that the cache stores.
            first_used: first frame row that the network uses.
        """
        backwards = np.linalg.inv(from_rows(homographies, first_cached, first_used))
        joined = np.concatenate([np.empty((len(homographies), 0)), *photometric], axis=1)
        return cls(torch.from_numpy(backwards).float(), torch.from_numpy(joined).float())

    def to(self, device: torch.device) -> "DrawnAugmentations":
        """Return a copy on the device."""
        return DrawnAugmentations(self.homographies.to(device), self.photometric.to(device))


def augment(kept: Tensor, draws: DrawnAugmentations, rows: tuple[int, int]) -> Tensor:
    """Apply drawn augmentations to frames.

    Args:
        kept: n x height x 320 x 3, uint8 RGB: the rows that the cache stores.
        draws: the frames' augmentations, on the same device.
        rows: first frame row that the network uses, and the one after the last.

    Returns:
        n x 160 x 320 x 3, uint8 RGB; black outside `rows`.
    """
    pixels = _warp(kept.permute(0, 3, 1, 2).float(), draws.homographies, rows[1] - rows[0])
    lit = _apply_photometric(pixels, draws.photometric)
    frames = torch.zeros((len(kept), ROWS, COLUMNS, 3), dtype=torch.uint8, device=kept.device)
    frames[:, slice(*rows)] = lit.permute(0, 2, 3, 1).to(torch.uint8)
    return frames


def _warp(pixels: Tensor, homographies: Tensor, height: int) -> Tensor:
    """Warp images; outside the source, the border is replicated for perspective and black for affine homographies."""
    y, x = torch.meshgrid(
        torch.arange(height, device=pixels.device), torch.arange(COLUMNS, device=pixels.device), indexing="ij"
    )
    shown = torch.stack([x, y, torch.ones_like(x)], -1).float()
    source = torch.einsum("nij,hwj->nhwi", homographies, shown)
    source = source[..., :2] / source[..., 2:]
    size = torch.tensor([COLUMNS - 1, pixels.shape[2] - 1], device=pixels.device)
    warped = functional.grid_sample(pixels, source / size * 2 - 1, "bilinear", "border", align_corners=True)
    inside = ((source > -1) & (source < size + 1)).all(-1)
    turned = (homographies[:, 2, :2] == 0).all(1)
    return warped * (inside | ~turned[:, None, None])[:, None]


def _apply_photometric(pixels: Tensor, photometric: Tensor) -> Tensor:
    for augmentation, columns in photometric_columns() if photometric.shape[1] else ():
        pixels = ON_DEVICE[augmentation.name](pixels, photometric[:, columns, None, None])
    return pixels


def _brightness(pixels: Tensor, parameters: Tensor) -> Tensor:
    return (pixels * parameters).round().clamp(0, 255)


def _shadow(pixels: Tensor, parameters: Tensor) -> Tensor:
    height = pixels.shape[2]
    top, bottom, right, factor = parameters.unbind(1)
    row = torch.arange(height, device=pixels.device)[:, None]
    column = torch.arange(COLUMNS, device=pixels.device)
    line = top + (bottom - top) * row / height
    in_shadow = torch.where(right > 0, column >= line, column <= line)
    return (pixels * torch.where(in_shadow, factor, 1.0)[:, None]).round()


def _saturation(pixels: Tensor, parameters: Tensor) -> Tensor:
    grey = pixels.mean(1, keepdim=True)
    return (grey + (pixels - grey) * parameters).round().clamp(0, 255)


# By name of the photometric augmentation. Pixels are n x 3 x rows x columns, 0..255; parameters n x size x 1 x 1
ON_DEVICE: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "brightness": _brightness,
    "shadow": _shadow,
    "saturation": _saturation,
}
