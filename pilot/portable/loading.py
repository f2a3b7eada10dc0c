"""Loading a model of either kind: a model file of this program, or an ONNX file."""

from pathlib import Path

from pilot.model.checkpoint import Model, load_model
from pilot.portable.onnx_model import SUFFIX, OnnxModel, load_onnx


def load(path: Path) -> Model | OnnxModel:
    """Load a model of either kind, by its suffix.

    Raises:
        UnusableModel: the file is missing, damaged, or cannot be used.
    """
    return load_onnx(path) if path.suffix == SUFFIX else load_model(path)
