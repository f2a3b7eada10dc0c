"""Quantising a network in an ONNX file: its convolutions compute with 8-bit integers."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static, shape_inference

# Not the dense layers, which take little time and make six times the error; not MatMul, which resizes frames.
QUANTISED = ("Conv",)


class Inputs(CalibrationDataReader):  # type: ignore[misc]
    """Gives prepared inputs to the calibration, which finds the range of each activation."""

    def __init__(self, name: str, inputs: Sequence[NDArray[Any]]) -> None:
        self._remaining: Iterator[dict[str, NDArray[Any]]] = iter([{name: value} for value in inputs])

    def get_next(self) -> dict[str, NDArray[Any]] | None:
        """Return the next input, None at the end."""
        return next(self._remaining, None)


def quantise(converted: onnx.ModelProto, inputs: Sequence[NDArray[Any]]) -> bytes:
    """Return the content of a file with a quantised copy of a model.

    The first layer stays as it is: it sees the colours of the frames, whose steps matter most, and costs little.

    Args:
        converted: the model.
        inputs: prepared inputs of typical frames, batches of one each.
    """
    layers = [node.name for node in converted.graph.node if node.op_type in QUANTISED]
    with tempfile.TemporaryDirectory() as folder:
        source, prepared, target = (Path(folder) / name for name in ("source.onnx", "prepared.onnx", "target.onnx"))
        onnx.save(converted, source)
        shape_inference.quant_pre_process(source, prepared, skip_symbolic_shape=True)
        quantize_static(
            prepared,
            target,
            Inputs(converted.graph.input[0].name, inputs),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=list(QUANTISED),
            nodes_to_exclude=layers[:1],
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        return target.read_bytes()
