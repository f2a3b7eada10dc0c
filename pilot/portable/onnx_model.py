"""Steering by an ONNX file: one of this program, or of another project with a description of its preprocessing."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray

from pilot.arrays import Frame
from pilot.model.checkpoint import UnusableModel
from pilot.portable.metadata import METADATA_KEY, ModelCard, read_card
from pilot.portable.preprocessing import Preprocessing, WrongDescription, input_shape, read_preprocessing
from pilot.signature import STEERING_ONLY, Signature
from pilot.vehicle import COLUMNS, ROWS

SUFFIX = ".onnx"
RAW_INPUT = "tensor(uint8)"
FRAMES = (ROWS, COLUMNS, 3)
LARGEST_FILE = 1 << 30  # bytes
EXAMPLE = (
    '{"steps": [{"crop": {"top": 60, "bottom": 25}}, {"resize": {"height": 66, "width": 200}}, {"colours": "YUV"}]}'
)

Prepare = Callable[[Frame], NDArray[Any]]


@dataclass(frozen=True)
class OnnxModel:
    """A network in ONNX Runtime, with one thread.

    Attributes:
        card: what is known about the model.
        session: of ONNX Runtime.
        prepare: a frame (160x320x3, uint8 RGB; with a history: K x 160 x 320 x 3) to the network's input.
        output: number of the value that is the steering, among those of all outputs; other values of the card's
            signature follow it.
        multiply: factor from that output to steering of -1..1.
    """

    card: ModelCard
    session: onnxruntime.InferenceSession
    prepare: Prepare
    output: int
    multiply: float

    @property
    def name(self) -> str:
        """Name of the network."""
        return self.card.name

    @property
    def config(self) -> dict[str, Any]:
        """The training options, if the file tells them."""
        return self.card.config

    @property
    def signature(self) -> Signature:
        """What the network takes and returns."""
        return self.card.signature

    def predict(self, frame: Frame) -> list[float]:
        """Return the outputs for a frame, or a history of frames, as `SteeringNetwork.predict` does.

        Raises:
            RuntimeError: ONNX Runtime could not run the network.
        """
        outputs = self.session.run(None, {self.session.get_inputs()[0].name: self.prepare(frame)})
        values = np.concatenate([np.ravel(output) for output in outputs])
        if self.output + self.signature.outputs > len(values):
            raise WrongDescription(f"steering output {self.output}: there are fewer values (the first one is 0)")
        return [float(value) * self.multiply for value in values[self.output :][: self.signature.outputs]]


def load_onnx(path: Path) -> OnnxModel:
    """Load an ONNX file; a network of another project is described in its metadata or in a .json file beside it.

    Raises:
        UnusableModel: the file is missing, damaged, needs other files or operators, or is not described.
    """
    if not path.is_file():
        raise UnusableModel(f"{path}: no such file; make one with: python export.py model.pt")
    if path.stat().st_size > LARGEST_FILE:
        raise UnusableModel(f"{path}: larger than {LARGEST_FILE >> 20} MB")
    return onnx_model(path, path.read_bytes())


def onnx_model(path: Path, content: bytes) -> OnnxModel:
    """Return the model in the content of an ONNX file, which need not be written yet.

    Raises:
        UnusableModel: as for `load_onnx`.
    """
    _check_single_file(path, content)
    session = _session(path, content)
    card = _card(path, session)
    try:
        model = _raw(card, session) if card.preprocessing is None else _described(card, card.preprocessing, session)
        _check_steering(model)
    except WrongDescription as error:
        raise UnusableModel(f"{path}: {error}") from error
    return model


def _check_single_file(path: Path, content: bytes) -> None:
    """Check that a file is an ONNX model, and that it needs no other files."""
    try:
        graph = onnx.load_model_from_string(content).graph
    except Exception as error:  # whatever the parser raises for a file of unknown origin
        raise UnusableModel(f"{path}: damaged, or not an ONNX file") from error
    if not graph.node:
        raise UnusableModel(f"{path}: damaged, or not an ONNX file")
    if any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in _tensors(graph)):
        raise UnusableModel(f"{path}: its weights lie in other files; export it as a single file")


def _tensors(graph: onnx.GraphProto) -> list[onnx.TensorProto]:
    """Return the stored tensors of a graph and of the graphs in it."""
    found = list(graph.initializer)
    for attribute in (attribute for node in graph.node for attribute in node.attribute):
        found += [attribute.t, *attribute.tensors]
        for inner in (attribute.g, *attribute.graphs):
            found += _tensors(inner) if inner.node or inner.initializer else []
    return found


def _session(path: Path, content: bytes) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # as process_settings.for_driving
    options.log_severity_level = 4  # fatal errors only: all others are raised
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions have no common base class
        raise UnusableModel(f"{path}: ONNX Runtime cannot use it ({first_line(error)})") from error


def first_line(error: Exception) -> str:
    """Return the first line of an error's message."""
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def _card(path: Path, session: onnxruntime.InferenceSession) -> ModelCard:
    """Return what the file, or the description beside it, says about the model."""
    text = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
    description = path.with_suffix(".json")
    try:
        if text is not None:
            return read_card(text)
        if description.exists():
            return ModelCard(path.stem, preprocessing=read_preprocessing(description))
    except ValueError as error:
        raise UnusableModel(f"{path}: {error}") from error
    if _takes_frames(session, STEERING_ONLY):
        return ModelCard(path.stem)
    raise UnusableModel(
        f"{path}: takes {_type(session)}, not frames as they are, and nothing says how to prepare them. Describe it in "
        f"{description.name} beside it, such as {EXAMPLE} (docs/models.md)"
    )


def _takes_frames(session: onnxruntime.InferenceSession, signature: Signature) -> bool:
    inputs = session.get_inputs()
    shape = tuple(inputs[0].shape[1:]) if inputs else ()
    return len(inputs) == 1 and inputs[0].type == RAW_INPUT and shape == _frames(signature)


def _frames(signature: Signature) -> tuple[int, ...]:
    return (signature.frames, *FRAMES) if signature.history else FRAMES


def _type(session: onnxruntime.InferenceSession) -> str:
    return " and ".join(f"{value.type} of {value.shape}" for value in session.get_inputs())


def _raw(card: ModelCard, session: onnxruntime.InferenceSession) -> OnnxModel:
    if not _takes_frames(session, card.signature):
        wanted = " x ".join(map(str, _frames(card.signature)))
        raise WrongDescription(f"takes {_type(session)} instead of frames, N x {wanted} of uint8")
    return OnnxModel(card, session, lambda frame: frame[None], 0, 1.0)


def _described(card: ModelCard, described: Preprocessing, session: onnxruntime.InferenceSession) -> OnnxModel:
    """Return a model of another project, after a check of its description against its input and output."""
    inputs = session.get_inputs()
    if len(inputs) != 1:
        raise WrongDescription(f"has {len(inputs)} inputs; only networks of one image can be used")
    shape = input_shape(described)
    expected = [length if isinstance(length, int) else None for length in inputs[0].shape]
    fits = len(shape) == len(expected) and all(
        wanted in (None, got) for wanted, got in zip(expected, shape, strict=True)
    )
    if not fits:
        raise WrongDescription(f"takes {inputs[0].shape}, but the described preprocessing gives {list(shape)}")
    dtype = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(uint8)": np.uint8}.get(inputs[0].type)
    if dtype is None:
        raise WrongDescription(f"takes {inputs[0].type}; only float32, float64 and uint8 can be used")
    return OnnxModel(
        card,
        session,
        lambda frame: described.prepare(frame).astype(dtype, copy=False),
        described.output,
        described.multiply,
    )


def _check_steering(model: OnnxModel) -> None:
    """Let the model steer once, so that what is wrong is known before the drive."""
    try:
        outputs = model.predict(np.zeros(_frames(model.signature), np.uint8))
    except WrongDescription:
        raise
    except Exception as error:
        raise WrongDescription(f"ONNX Runtime cannot run it ({first_line(error)})") from error
    if not np.isfinite(outputs).all():
        raise WrongDescription("steers by no finite number; its training must have diverged")
