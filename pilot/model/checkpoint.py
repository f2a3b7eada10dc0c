"""model.pt: a network's name and weights, how it was trained and how good it is; safe to load.

The file holds only tensors, numbers, texts, lists and dictionaries, and is read with
`weights_only=True`: loading a stranger's model runs no code of his.
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
    """The file is no model of ours; the message says what it is and what to do."""


@dataclass(frozen=True)
class Model:
    """A trained network and what is known about it.

    Attributes:
        name: the network's name.
        network: in evaluation mode, on the CPU.
        config: the training's options, as plain values.
        data: summary of the data it was trained on.
        metrics: validation figures of the epoch that was kept.
    """

    name: str
    network: SteeringNetwork
    config: dict[str, Any]
    data: dict[str, Any]
    metrics: dict[str, Any]


def save_model(path: Path, model: Model) -> None:
    """Write a model file, whole or not at all."""
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
    """Read a model file without running anything from it.

    Raises:
        UnusableModel: the file is missing, damaged, or no model of this program.
    """
    content = load_values(path, "train one with: python model.py")
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UnusableModel(f"{path}: holds no model of this program. Train one with: python model.py")
    if content["version"] > VERSION or content["network"] not in network_names():
        raise UnusableModel(f"{path}: made by a newer version of this program (network {content['network']!r})")
    network = build_network(content["network"])
    try:
        network.load_state_dict(content["weights"])
    except RuntimeError as error:
        raise UnusableModel(f"{path}: its weights do not fit the network {content['network']!r}. Train anew") from error
    return Model(content["network"], network.eval(), content["config"], content["data"], content["metrics"])


def load_values(path: Path, cure: str) -> Any:
    """Read a file of tensors and plain values.

    Raises:
        UnusableModel: the file is missing, damaged, or wants to run code.
    """
    if not path.is_file():
        raise UnusableModel(f"{path}: no such file; {cure}")
    try:
        if not zipfile.is_zipfile(path):  # what torch.save writes; older pickles are not even looked into
            raise ValueError("not a zip file")
        return torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError, OSError) as error:
        raise UnusableModel(f"{path}: damaged, or not written by this program; {cure}") from error


def to_jsonable(value: Any) -> Any:
    """A value with dataclasses, paths and tuples turned into what JSON knows."""
    return json.loads(json.dumps(value, default=_jsonable))


def _jsonable(value: Any) -> Any:
    return dataclasses.asdict(value) if dataclasses.is_dataclass(value) and not isinstance(value, type) else str(value)
