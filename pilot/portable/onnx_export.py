"""Writing a trained network as one self-contained ONNX file: frames of 160x320 RGB bytes in, steering out."""

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator

import onnx
import torch
from torch import nn

from pilot.model.checkpoint import Model
from pilot.model.inference import fold_dense
from pilot.model.steering_network import SteeringNetwork
from pilot.portable.metadata import METADATA_KEY, ModelCard
from pilot.portable.resize import resize_antialiased
from pilot.signature import STEERING_ONLY
from pilot.vehicle import COLUMNS, ROWS

INPUT, OUTPUT, PLAN = "frames", "steering", "plan"
TOLERANCE = 1e-5  # of the steering


def export_model(model: Model) -> onnx.ModelProto:
    """Convert a trained model.

    Its input is "frames", N x 160 x 320 x 3, uint8 RGB; its output "steering", N, float32, not clipped. A network of
    another signature takes N x K x 160 x 320 x 3, and its output, "plan", is that of `SteeringNetwork.predict`.
    """
    signature = model.network.signature
    frames = (2, signature.frames) if signature.history else (2,)
    example = torch.zeros((*frames, ROWS, COLUMNS, 3), dtype=torch.uint8)
    card = ModelCard(model.name, model.config, model.data, model.metrics, signature=signature)
    folded = fold_dense(model.network).eval()
    plain = signature == STEERING_ONLY
    return with_card(export_network(folded if plain else _AllOutputs(folded), example, OUTPUT if plain else PLAN), card)


class _AllOutputs(nn.Module):
    def __init__(self, network: SteeringNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        return self.network.predict(frames)


def export_network(network: nn.Module, example: torch.Tensor, output: str = OUTPUT) -> onnx.ModelProto:
    """Convert a network of one input and one output, for any number of images; `example` is a batch of two."""
    with _quiet():
        program = torch.onnx.export(
            network,
            (example,),
            input_names=[INPUT],
            output_names=[output],
            dynamic_shapes=({0: torch.export.Dim("n", min=1)},),
            external_data=False,
            verbose=False,
            custom_translation_table={torch.ops.aten._upsample_bilinear2d_aa.default: resize_antialiased},
        )
    assert program is not None
    converted: onnx.ModelProto = program.model_proto
    onnx.checker.check_model(converted, full_check=True)
    return converted


def with_card(converted: onnx.ModelProto, card: ModelCard) -> onnx.ModelProto:
    """Replace a converted model's metadata by a card; returns the model."""
    del converted.metadata_props[:]
    onnx.helper.set_model_props(converted, {METADATA_KEY: card.to_json()})
    for node in converted.graph.node:  # paths and lines of the source code
        del node.metadata_props[:]
        node.doc_string = ""
    return converted


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress what the exporter says about operators of other packages and its own deprecations."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logger.setLevel(level)
