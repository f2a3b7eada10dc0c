"""What Keras's layers compute, as PyTorch modules.

Between them, images are N x channels x rows x columns, as PyTorch wants them; the network takes them in Keras's order,
N x rows x columns x channels, and puts them back into it before they are flattened.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional


class Atan(nn.Module):
    """Arc tangent, the output of NVIDIA's network in TensorFlow."""

    def forward(self, values: Tensor) -> Tensor:
        """Return the arc tangent of all values."""
        return torch.atan(values)


class Scale(nn.Module):
    """Divides and subtracts: values / divide - subtract."""

    def __init__(self, divide: float, subtract: float) -> None:
        super().__init__()
        self.divide, self.subtract = divide, subtract

    def forward(self, values: Tensor) -> Tensor:
        """Return the scaled values."""
        return values / self.divide - self.subtract


class Padded(nn.Module):
    """A convolution or pooling with Keras's padding "same": more at the bottom and right if the number is odd."""

    def __init__(self, layer: nn.Module, size: tuple[int, int], stride: tuple[int, int], value: float) -> None:
        super().__init__()
        self.layer, self.size, self.stride, self.value = layer, size, stride, value

    def forward(self, images: Tensor) -> Tensor:
        """Pad and apply the layer."""
        sides: list[int] = []
        for length, size, stride in zip(images.shape[-2:], self.size, self.stride, strict=True):
            total = max((-(-length // stride) - 1) * stride + size - length, 0)
            sides = [total // 2, total - total // 2, *sides]
        padded: Tensor = self.layer(functional.pad(images, sides, value=self.value))
        return padded


class Crop(nn.Module):
    """Crops rows and columns: top, bottom, left, right."""

    def __init__(self, rows: tuple[int, int], columns: tuple[int, int]) -> None:
        super().__init__()
        self.rows, self.columns = rows, columns

    def forward(self, images: Tensor) -> Tensor:
        """Return the cropped images."""
        (top, bottom), (left, right) = self.rows, self.columns
        return images[:, :, top : images.shape[2] - bottom, left : images.shape[3] - right]


class Resize(nn.Module):
    """Bilinear resizing as of tf.image.resize in TensorFlow 2."""

    def __init__(self, height: int, width: int) -> None:
        super().__init__()
        self.size = height, width

    def forward(self, images: Tensor) -> Tensor:
        """Return the resized images."""
        return functional.interpolate(images, self.size, mode="bilinear", align_corners=False)


class Flatten(nn.Module):
    """Flattens images in Keras's order: rows, columns, channels."""

    def forward(self, images: Tensor) -> Tensor:
        """Return N x values."""
        return images.permute(0, 2, 3, 1).flatten(1) if images.ndim == 4 else images.flatten(1)


class KerasNetwork(nn.Module):
    """A chain of converted layers; takes images in Keras's order, N x rows x columns x channels."""

    def __init__(self, layers: list[nn.Module]) -> None:
        super().__init__()
        self.layers = nn.Sequential(*layers)

    def forward(self, images: Tensor) -> Tensor:
        """Return the network's output, N x values."""
        output: Tensor = self.layers(images.permute(0, 3, 1, 2))
        return output


class EitherShape(nn.Module):
    """Batch normalisation of images and of vectors."""

    def __init__(self, normalisation: nn.BatchNorm2d) -> None:
        super().__init__()
        self.normalisation = normalisation

    def forward(self, values: Tensor) -> Tensor:
        """Return the normalised values."""
        images = values if values.ndim == 4 else values[:, :, None, None]
        normalised: Tensor = self.normalisation(images)
        return normalised.reshape(values.shape)
