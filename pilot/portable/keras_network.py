"""Conversion of Keras layers into a PyTorch network that gives the same output."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pilot.arrays import Floats
from pilot.portable.keras_file import KerasLayer
from pilot.portable.keras_modules import Atan, Crop, EitherShape, Flatten, KerasNetwork, Padded, Resize, Scale
from pilot.portable.preprocessing import WrongDescription, scale_values

Lambdas = Mapping[str, dict[str, Any]]

ACTIVATIONS: dict[str, type[nn.Module]] = {
    "relu": nn.ReLU,
    "relu6": nn.ReLU6,
    "elu": nn.ELU,
    "selu": nn.SELU,
    "gelu": nn.GELU,
    "tanh": nn.Tanh,
    "sigmoid": nn.Sigmoid,
    "softplus": nn.Softplus,
    "softsign": nn.Softsign,
    "swish": nn.SiLU,
    "silu": nn.SiLU,
    "atan": Atan,
}
NOTHING = ("InputLayer", "Dropout", "SpatialDropout2D", "GaussianNoise", "GaussianDropout", "ActivityRegularization")
SMALLEST = 1e-3  # default epsilon of Keras's BatchNormalization


def keras_network(layers: list[KerasLayer], lambdas: Lambdas) -> KerasNetwork:
    """Return the network with the converted layers and their weights, in evaluation mode.

    Args:
        layers: from input to output.
        lambdas: what each Lambda layer computes: a scale or resize step of `preprocessing`, by layer name.

    Raises:
        WrongDescription: a layer cannot be converted, or a Lambda layer is not described.
    """
    converted: list[nn.Module] = []
    for layer in layers:
        try:
            converted += _convert(layer, lambdas)
        except (KeyError, TypeError, IndexError, ValueError, RuntimeError) as error:
            if isinstance(error, WrongDescription):
                raise
            raise WrongDescription(f"layer {layer.name} ({layer.kind}) cannot be converted: {error!r}") from error
    return KerasNetwork(converted).eval()


def input_size(layers: list[KerasLayer]) -> tuple[int, int, int] | None:
    """Return rows, columns and channels of a network's input, if its first layer tells them."""
    for layer in layers[:1]:
        for key in ("batch_input_shape", "batch_shape"):
            shape = layer.config.get(key)
            if shape and len(shape) == 4 and all(isinstance(length, int) for length in shape[1:]):
                return int(shape[1]), int(shape[2]), int(shape[3])
    return None


def _convert(layer: KerasLayer, lambdas: Lambdas) -> list[nn.Module]:
    if layer.kind == "Lambda":
        return [_lambda(layer.name, lambdas)]
    if layer.kind in NOTHING:
        return []
    if layer.config.get("data_format") == "channels_first" or layer.config.get("dim_ordering") == "th":
        raise WrongDescription(f"layer {layer.name}: images in Theano's order (channels first) are not converted")
    convert = LAYERS.get(layer.kind)
    if convert is None:
        raise WrongDescription(f"layer {layer.name}: a {layer.kind} is not converted; there are {', '.join(LAYERS)}")
    return [convert(layer), *_activation(layer.config.get("activation"))]


def _lambda(name: str, lambdas: Lambdas) -> nn.Module:
    step = lambdas.get(name)
    if not isinstance(step, dict) or len(step) != 1 or not set(step) <= {"scale", "resize"}:
        example = f'"lambdas": {{"{name}": {{"scale": {{"divide": 127.5, "subtract": 1}}}}}}'
        raise WrongDescription(
            f"layer {name}: a Lambda contains Python code, which is not executed. Say in the description what it "
            f"computes (scale or resize): {example}"
        )
    if "scale" in step:
        return Scale(*scale_values(step["scale"]))
    return Resize(int(step["resize"]["height"]), int(step["resize"]["width"]))


# Layers


def _convolution(layer: KerasLayer) -> nn.Module:
    """Convert Conv2D, and Convolution2D of Keras 1, whose options have other names."""
    config, kernel = layer.config, layer.weights[0]
    stride = _pair(config.get("strides", config.get("subsample", 1)))
    dilation = _pair(config.get("dilation_rate", 1))
    size = (int(kernel.shape[0]), int(kernel.shape[1]))
    channels, groups = int(kernel.shape[2]), int(config.get("groups", 1))
    convolution = nn.Conv2d(
        channels * groups,
        int(kernel.shape[3]),
        size,
        stride,
        dilation=dilation,
        groups=groups,
        bias=len(layer.weights) > 1,
    )
    _fill(convolution.weight, kernel.transpose(3, 2, 0, 1))
    if convolution.bias is not None:
        _fill(convolution.bias, layer.weights[1])
    reach = (dilation[0] * (size[0] - 1) + 1, dilation[1] * (size[1] - 1) + 1)
    return _padded(convolution, config, reach, stride, 0.0)


def _max_pooling(layer: KerasLayer) -> nn.Module:
    size = _pair(layer.config.get("pool_size", 2))
    stride = _pair(layer.config.get("strides") or size)
    return _padded(nn.MaxPool2d(size, stride), layer.config, size, stride, float("-inf"))


def _average_pooling(layer: KerasLayer) -> nn.Module:
    size = _pair(layer.config.get("pool_size", 2))
    stride = _pair(layer.config.get("strides") or size)
    if _padding(layer.config) == "same":
        raise ValueError("padding same")
    return nn.AvgPool2d(size, stride)


def _padded(
    module: nn.Module, config: dict[str, Any], size: tuple[int, int], stride: tuple[int, int], value: float
) -> nn.Module:
    padding = _padding(config)
    if padding not in ("same", "valid"):
        raise ValueError(f"padding {padding}")
    return Padded(module, size, stride, value) if padding == "same" else module


def _padding(config: dict[str, Any]) -> str:
    return str(config.get("padding", config.get("border_mode", "valid")))


def _dense(layer: KerasLayer) -> nn.Module:
    kernel = layer.weights[0]
    linear = nn.Linear(kernel.shape[0], kernel.shape[1], bias=len(layer.weights) > 1)
    _fill(linear.weight, kernel.T)
    if linear.bias is not None:
        _fill(linear.bias, layer.weights[1])
    return linear


def _batch_normalisation(layer: KerasLayer) -> nn.Module:
    """Convert BatchNormalization; of gamma and beta, either may be missing."""
    weights = list(layer.weights)
    gamma = weights.pop(0) if layer.config.get("scale", True) else None
    beta = weights.pop(0) if layer.config.get("center", True) else None
    mean, variance = weights
    if layer.config.get("mode", 0) != 0:
        raise ValueError("mode of Keras 1 other than 0")
    normalisation = nn.BatchNorm2d(len(mean), eps=float(layer.config.get("epsilon", SMALLEST)))
    normalisation.running_mean, normalisation.running_var = torch.tensor(mean).float(), torch.tensor(variance).float()
    _fill(normalisation.weight, np.ones_like(mean) if gamma is None else gamma)
    _fill(normalisation.bias, np.zeros_like(mean) if beta is None else beta)
    return EitherShape(normalisation)


def _rescaling(layer: KerasLayer) -> nn.Module:
    return Scale(1 / float(layer.config["scale"]), -float(layer.config.get("offset", 0.0)))


def _crop(layer: KerasLayer) -> nn.Module:
    rows, columns = layer.config["cropping"]
    return Crop(_pair(rows), _pair(columns))


def _zero_padding(layer: KerasLayer) -> nn.Module:
    rows, columns = layer.config["padding"]
    return nn.ZeroPad2d((*_pair(columns), *_pair(rows)))


def _leaky(layer: KerasLayer) -> nn.Module:
    return nn.LeakyReLU(float(layer.config.get("negative_slope", layer.config.get("alpha", 0.3))))


def _only_activation(layer: KerasLayer) -> nn.Module:
    del layer  # `_convert` adds the activation of every layer
    return nn.Identity()


LAYERS: dict[str, Callable[[KerasLayer], nn.Module]] = {
    "Conv2D": _convolution,
    "Convolution2D": _convolution,
    "MaxPooling2D": _max_pooling,
    "AveragePooling2D": _average_pooling,
    "GlobalAveragePooling2D": lambda _: nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Flatten()),
    "Dense": _dense,
    "Flatten": lambda _: Flatten(),
    "BatchNormalization": _batch_normalisation,
    "Rescaling": _rescaling,
    "Cropping2D": _crop,
    "ZeroPadding2D": _zero_padding,
    "Activation": _only_activation,
    "ReLU": lambda _: nn.ReLU(),
    "ELU": lambda layer: nn.ELU(float(layer.config.get("alpha", 1.0))),
    "LeakyReLU": _leaky,
}


def _activation(name: Any) -> list[nn.Module]:
    if name is None or name == "linear":
        return []
    if not isinstance(name, str) or name not in ACTIVATIONS:
        raise WrongDescription(f"activation {name!r} is not converted; there are {', '.join(ACTIVATIONS)}")
    return [ACTIVATIONS[name]()]


def _pair(value: Any) -> tuple[int, int]:
    first, second = value if isinstance(value, list | tuple) else (value, value)
    return int(first), int(second)


def _fill(parameter: Tensor, values: Floats) -> None:
    with torch.no_grad():
        parameter.copy_(torch.tensor(np.ascontiguousarray(values)).reshape(parameter.shape))
