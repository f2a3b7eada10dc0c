"""PyTorch's antialiased resizing of uint8 images in ONNX, to the bit.

ONNX has an operator for antialiased resizing, but it rounds differently, which changed the steering of one network by
0.004. PyTorch computes with integers (aten/src/ATen/native/cpu/UpSampleKernel.cpp): along each axis a sum of pixels
times weights of at most 16 bits, rounded to uint8. All these integers are below 2^24, so that float32 is exact too.
"""

from typing import Any

import numpy as np
from onnx import TensorProto, numpy_helper
from onnxscript import opset18 as op

from pilot.arrays import Matrix

MOST_BITS = 22  # of the weights' scale, in PyTorch
WEIGHT_LIMIT = 1 << 15  # int16


def resize_antialiased(
    pixels: Any,
    size: list[int],
    _align_corners: bool,
    _scale_rows: float | None = None,
    _scale_columns: float | None = None,
) -> Any:
    """Translate `aten._upsample_bilinear2d_aa` of N x C x rows x columns, uint8, for `torch.onnx.export`."""
    rows, columns = (int(length) for length in pixels.shape[-2:])
    resized = _resize_last_axis(op.Cast(pixels, to=TensorProto.FLOAT), columns, int(size[1]))
    resized = _resize_last_axis(op.Transpose(resized, perm=[0, 1, 3, 2]), rows, int(size[0]))
    return op.Cast(op.Transpose(resized, perm=[0, 1, 3, 2]), to=TensorProto.UINT8)


def _resize_last_axis(pixels: Any, before: int, after: int) -> Any:
    weights, bits = integer_weights(before, after)
    matrix = op.Constant(value=numpy_helper.from_array(np.ascontiguousarray(weights.T, np.float32)))
    half, unit = op.Constant(value_float=2.0 ** (bits - 1)), op.Constant(value_float=2.0**-bits)
    rounded = op.Floor(op.Mul(op.Add(op.MatMul(pixels, matrix), half), unit))
    return op.Clip(rounded, op.Constant(value_float=0.0), op.Constant(value_float=255.0))


def integer_weights(before: int, after: int) -> tuple[Matrix, int]:
    """Return PyTorch's integer weights of a triangular filter, `after` x `before`, and the bits of their scale."""
    scale = before / after
    support = max(scale, 1.0)
    centres = scale * (np.arange(after) + 0.5)
    first = np.maximum((centres - support + 0.5).astype(int), 0)
    end = np.minimum((centres + support + 0.5).astype(int), before)
    places = np.arange(before)
    weights = np.clip(1 - np.abs(places + 0.5 - centres[:, None]) / support, 0, None)
    weights[(places < first[:, None]) | (places >= end[:, None])] = 0
    weights /= weights.sum(1, keepdims=True)
    bits = 0
    while bits < MOST_BITS and int(weights.max() * (1 << (bits + 1)) + 0.5) < WEIGHT_LIMIT:
        bits += 1
    return np.floor(weights * (1 << bits) + 0.5), bits
