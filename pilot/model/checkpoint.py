"""The model file model.pt: a network's name and weights, training options, data summary and validation metrics.

The file contains only tensors, numbers, strings, lists and dictionaries and is loaded with `weights_only=True`, so that
a model from an untrusted source cannot execute code. A checksum of all values reveals damage.
"""

import dataclasses
import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from pilot.files import write_atomically
from pilot.model.build import build_network
from pilot.model.networks import network_names
from pilot.model.steering_network import SteeringNetwork

FORMAT, VERSION = "behavioral-cloning steering model", 1
CHECKSUM = "sha256"
TYPES = {"version": int, "network": str, "weights": dict, "config": dict, "data": dict, "metrics": dict}


class UnusableModel(ValueError):
    """The model or state cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class Model:
    """A trained network with its options and metrics.

    Attributes:
        name: name of the network.
        network: the network in evaluation mode, on the CPU.
        config: the training options, as plain values.
        data: summary of the training data.
        metrics: validation metrics of the selected epoch.
    """

    name: str
    network: SteeringNetwork
    config: dict[str, Any]
    data: dict[str, Any]
    metrics: dict[str, Any]


def save_model(path: Path, model: Model) -> None:
    """Write a model file atomically.

    Raises:
        OSError: the file cannot be written.
    """
    content = {
        "format": FORMAT,
        "version": VERSION,
        "network": model.name,
        "weights": {key: value.detach().cpu().contiguous() for key, value in model.network.state_dict().items()},
        "config": to_jsonable(model.config),
        "data": to_jsonable(model.data),
        "metrics": to_jsonable(model.metrics),
    }
    save_values(path, content)


def load_model(path: Path) -> Model:
    """Load a model file without executing any code from it.

    Raises:
        UnusableModel: the file is missing, damaged, not a model of this program, or its weights are not finite.
            (`pilot.portable.loading.load` loads ONNX files, too.)
    """
    if path.suffix == ".onnx":
        raise UnusableModel(f"{path}: an ONNX file only steers; give the .pt file from which it was made")
    content = load_values(path, FORMAT, "train one with: python model.py")
    _check_types(path, content)
    version, name = content["version"], content["network"]
    if version > VERSION or name not in network_names():
        raise UnusableModel(f"{path}: made by a newer version of this program (network {name!r})")
    network = _network_with(path, name, content["weights"])
    return Model(name, network, content["config"], content["data"], content["metrics"])


def _check_types(path: Path, content: dict[str, Any]) -> None:
    for key, expected in TYPES.items():
        if not isinstance(content.get(key), expected):
            raise UnusableModel(f"{path}: damaged, no valid {key!r}. Train a new model with: python model.py")


def _network_with(path: Path, name: str, weights: Any) -> SteeringNetwork:
    network = build_network(name)
    try:
        network.load_state_dict(weights)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise UnusableModel(f"{path}: its weights do not fit the network {name!r}. Train a new model") from error
    if not all(bool(value.isfinite().all()) for value in network.state_dict().values()):
        raise UnusableModel(f"{path}: its weights are not finite, the training must have diverged. Train a new model")
    return network.eval()


def save_values(path: Path, content: dict[str, Any]) -> None:
    """Write tensors and plain values atomically, with a checksum of them.

    Raises:
        OSError: the file cannot be written.
    """
    packed = io.BytesIO()  # on a full disk, torch.save into a file fails with a message about the inside of PyTorch
    torch.save({**content, CHECKSUM: digest(content)}, packed)
    write_atomically(path, lambda file: file.write(packed.getbuffer()))


def load_values(path: Path, kind: str, cure: str) -> dict[str, Any]:
    """Load a file written with `save_values`; those of earlier versions have no checksum of their own.

    Args:
        path: path of the file.
        kind: value of its "format".
        cure: what the user can do if the file cannot be used; appended to the error message.

    Raises:
        UnusableModel: the file is missing, damaged or of another kind, or loading it would execute code or fill the
            memory.
    """
    if not path.is_file():
        raise UnusableModel(f"{path}: no such file; {cure}")
    try:
        _check_archive(path)
        content = torch.load(path, map_location="cpu", weights_only=True)
        expected = content.pop(CHECKSUM, None)
        if expected != (None if expected is None else digest(content)):
            raise ValueError("checksum")
    except Exception as error:  # whatever a file of unknown origin makes the unpickler raise
        raise UnusableModel(f"{path}: damaged, or not written by this program; {cure}") from error
    if content.get("format") != kind:
        raise UnusableModel(f"{path}: not a {kind} of this program; {cure}")
    return dict(content)


def _check_archive(path: Path) -> None:
    """Check a file of `torch.save` before it is unpacked: an uncompressed zip archive, not larger than it is.

    PyTorch ignores the checksums in the archive; a legacy pickle file would be opened in other ways.
    """
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
            raise ValueError("compressed")
        if sum(entry.file_size for entry in entries) > path.stat().st_size:
            raise ValueError("overlapping")
        if archive.testzip() is not None:
            raise ValueError("checksum")


def digest(value: Any) -> str:
    """Return a SHA-256 digest of nested dictionaries, lists, tensors and plain values.

    Raises:
        ValueError: a tensor claims to be larger than its memory.
    """
    sha256 = hashlib.sha256()
    for piece in _pieces(value):
        sha256.update(piece)
    return sha256.hexdigest()


def _pieces(value: Any) -> Iterator[bytes | memoryview]:
    if isinstance(value, torch.Tensor):
        if value.numel() * value.element_size() > value.untyped_storage().nbytes():
            raise ValueError("a tensor of repeated values")
        yield f"{value.dtype} {tuple(value.shape)}".encode()
        yield value.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().data
    elif isinstance(value, dict):
        for key, item in value.items():
            yield f"{key!r}:".encode()
            yield from _pieces(item)
    elif isinstance(value, list | tuple):
        yield f"{len(value)}".encode()
        for item in value:
            yield from _pieces(item)
    else:
        yield repr(value).encode()


def to_jsonable(value: Any) -> Any:
    """Convert dataclasses, paths and tuples in a value to JSON types."""
    return json.loads(json.dumps(value, default=_jsonable))


def _jsonable(value: Any) -> Any:
    return dataclasses.asdict(value) if dataclasses.is_dataclass(value) and not isinstance(value, type) else str(value)
