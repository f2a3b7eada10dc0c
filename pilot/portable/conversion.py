"""Conversion of a model file of any supported kind into ONNX."""

from dataclasses import dataclass
from pathlib import Path

import onnx
import torch

from pilot.arrays import Frame
from pilot.model.checkpoint import UnusableModel, load_model
from pilot.portable.comparison import Predict
from pilot.portable.keras_file import SUFFIXES, read_keras
from pilot.portable.keras_network import input_size, keras_network
from pilot.portable.metadata import ModelCard
from pilot.portable.onnx_export import export_model, export_network, with_card
from pilot.portable.preprocessing import Preprocessing, WrongDescription, input_shape, read_preprocessing


@dataclass(frozen=True)
class Conversion:
    """A converted model.

    Attributes:
        model: as ONNX.
        original: the original's outputs for a frame (160x320x3, uint8 RGB), or a history; None: it was ONNX already.
    """

    model: onnx.ModelProto
    original: Predict | None


def convert(path: Path, description: Path | None = None) -> Conversion:
    """Convert a model file.

    Args:
        path: a model of this program, a Keras file, or an ONNX file.
        description: file that says how a network of another project prepares frames; None: it takes them as they are,
            or, if it is an ONNX file, says so itself.

    Raises:
        UnusableModel: the model cannot be used.
        WrongDescription: the description cannot be used, or does not fit the network.
    """
    described = read_preprocessing(description) if description else None
    if path.suffix == ".onnx":
        return Conversion(_read_onnx(path, described), None)
    if path.suffix in SUFFIXES:
        return _convert_keras(path, described or Preprocessing())
    model = load_model(path)

    def predict(frame: Frame) -> list[float]:
        with torch.inference_mode():
            outputs: list[float] = model.network.predict(torch.from_numpy(frame[None]))[0].tolist()
        return outputs

    return Conversion(export_model(model), predict)


def _convert_keras(path: Path, described: Preprocessing) -> Conversion:
    layers = read_keras(path)
    try:
        network = keras_network(layers, described.lambdas)
        shape = input_shape(described)
        if (size := input_size(layers)) and shape[1:] != size:
            raise WrongDescription(f"takes images of {size}, but the described preprocessing gives {shape[1:]}")
        with torch.inference_mode():
            outputs = network(torch.zeros(shape)).reshape(1, -1).shape[1]
    except (WrongDescription, RuntimeError) as error:
        raise UnusableModel(f"{path}: {error}. See --preprocessing in docs/models.md") from error
    if described.output >= outputs:
        raise UnusableModel(f"{path}: steering output {described.output}: it has {outputs} (the first one is 0)")

    def predict(frame: Frame) -> list[float]:
        with torch.inference_mode():
            output = network(torch.from_numpy(described.prepare(frame)))
        return [float(output.reshape(-1)[described.output]) * described.multiply]

    card = ModelCard(path.stem, preprocessing=described)
    return Conversion(with_card(export_network(network, torch.zeros((2, *shape[1:]))), card), predict)


def _read_onnx(path: Path, described: Preprocessing | None) -> onnx.ModelProto:
    """Return the content of an ONNX file, with its description inside."""
    if not path.is_file():
        raise UnusableModel(f"{path}: no such file")
    try:
        converted = onnx.load(path, load_external_data=False)
    except Exception as error:  # whatever the parser raises for a file of unknown origin
        raise UnusableModel(f"{path}: damaged, or not an ONNX file") from error
    return with_card(converted, ModelCard(path.stem, preprocessing=described)) if described else converted
