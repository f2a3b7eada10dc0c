"""The model file model.pt: a network's name and weights, training options, data summary and validation metrics.

The file contains only tensors, numbers, strings, lists and dictionaries and is loaded with `weights_only=True`, so that
a model from an untrusted source cannot execute code.
"""

import dataclasses
import json
import pickle
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from pilot.files import write_atomically
from pilot.model.build import build_network
from pilot.model.networks import network_names
from pilot.model.steering_network import SteeringNetwork

FORMAT, VERSION = "behavioral-cloning steering model", 1


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
    write_atomically(path, lambda file: torch.save(content, file))


def load_model(path: Path) -> Model:
    """Load a model file without executing any code from it.

    Raises:
        UnusableModel: the file is missing, damaged, or not a model of this program.
    """
    content = load_values(path, "train one with: python model.py")
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UnusableModel(f"{path}: not a model of this program. Train one with: python model.py")
    if content["version"] > VERSION or content["network"] not in network_names():
        raise UnusableModel(f"{path}: made by a newer version of this program (network {content['network']!r})")
    network = build_network(content["network"])
    try:
        network.load_state_dict(content["weights"])
    except RuntimeError as error:
        raise UnusableModel(
            f"{path}: its weights do not fit the network {content['network']!r}. Train a new model"
        ) from error
    return Model(content["network"], network.eval(), content["config"], content["data"], content["metrics"])


def load_values(path: Path, cure: str) -> Any:
    """Load a file of tensors and plain values.

    Args:
        path: path of a file written with `torch.save`.
        cure: what the user can do if the file cannot be used; appended to the error message.

    Raises:
        UnusableModel: the file is missing or damaged, or loading it would execute code.
    """
    if not path.is_file():
        raise UnusableModel(f"{path}: no such file; {cure}")
    try:
        if not zipfile.is_zipfile(path):  # the format of torch.save; legacy pickle files are never opened
            raise ValueError("not a zip file")
        return torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError, OSError) as error:
        raise UnusableModel(f"{path}: damaged, or not written by this program; {cure}") from error


def to_jsonable(value: Any) -> Any:
    """Convert dataclasses, paths and tuples in a value to JSON types."""
    return json.loads(json.dumps(value, default=_jsonable))


def _jsonable(value: Any) -> Any:
    return dataclasses.asdict(value) if dataclasses.is_dataclass(value) and not isinstance(value, type) else str(value)
