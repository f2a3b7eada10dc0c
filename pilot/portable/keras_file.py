"""Reading the Keras files that students publish: architecture and weights, without Keras or TensorFlow.

Three forms: .h5 with both (Keras 1 and 2), .h5 with weights only and the architecture in a .json file beside it (usual
in 2016 and 2017), and .keras (Keras 3: a zip archive). Nothing in them is executed: Lambda layers contain Python
bytecode, which is not read.
"""

import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pilot.arrays import Floats
from pilot.model.checkpoint import UnusableModel

SUFFIXES = (".h5", ".hdf5", ".keras")
LARGEST = 1 << 30  # bytes of all weights
CONTAINERS = ("Sequential", "Model", "Functional")


@dataclass(frozen=True)
class KerasLayer:
    """A layer of a Keras network.

    Attributes:
        kind: name of its class, such as Convolution2D (Keras 1) or Conv2D.
        name: of the layer.
        config: its options.
        weights: in the order in which Keras creates them.
    """

    kind: str
    name: str
    config: dict[str, Any]
    weights: tuple[Floats, ...]


def read_keras(path: Path) -> list[KerasLayer]:
    """Return the layers of a network, from its input to its output.

    Raises:
        UnusableModel: the file is missing or damaged, or its layers are not a chain.
    """
    if not path.is_file():
        raise UnusableModel(f"{path}: no such file")
    try:
        return _read_archive(path) if zipfile.is_zipfile(path) else _read_h5(path)
    except UnusableModel:
        raise
    except Exception as error:  # whatever a file of unknown origin makes the readers raise
        raise UnusableModel(f"{path}: damaged, or not a Keras file ({error or type(error).__name__})") from error


def _read_h5(path: Path) -> list[KerasLayer]:
    with h5py.File(path, "r") as file:
        architecture = file.attrs.get("model_config")
        content = json.loads(architecture) if architecture is not None else _architecture_beside(path)
        return _layers(path, content, file)


def _architecture_beside(path: Path) -> Any:
    """Return the architecture of a file that has weights only."""
    beside = path.with_name(path.name.removesuffix(path.suffix).removesuffix(".weights") + ".json")
    if not beside.is_file():
        raise UnusableModel(f"{path}: contains weights only; put the architecture beside it, as {beside.name}")
    content = json.loads(beside.read_text(encoding="utf-8"))
    return json.loads(content) if isinstance(content, str) else content  # json.dump of to_json() was common


def _read_archive(path: Path) -> list[KerasLayer]:
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > LARGEST:
            raise UnusableModel(f"{path}: larger than {LARGEST >> 20} MB")
        content = json.loads(archive.read("config.json"))
        stored = io.BytesIO(archive.read("model.weights.h5"))
    with h5py.File(stored, "r") as file:
        return _layers(path, content, file)


def _layers(path: Path, content: Any, file: h5py.File) -> list[KerasLayer]:
    """Return the layers of an architecture with their weights in a file."""
    _check_size(path, file)
    numbered = file.get("layers", file.get("_layer_checkpoint_dependencies"))  # Keras 3
    groups = file.get("model_weights", file)
    counts: dict[str, int] = {}
    return [
        KerasLayer(
            kind,
            name,
            config,
            _weights_of(groups, name) if numbered is None else _variables(numbered, _stored_name(kind, counts)),
        )
        for kind, name, config in chain(path, content)
    ]


def _weights_of(groups: h5py.Group, layer: str) -> tuple[Floats, ...]:
    """Return a layer's weights as Keras 1 and 2 store them."""
    if layer not in groups:
        return ()
    group = groups[layer]
    names = [name.decode() if isinstance(name, bytes) else str(name) for name in group.attrs.get("weight_names", ())]
    return tuple(np.asarray(group[name], np.float64) for name in names)


def _stored_name(kind: str, counts: dict[str, int]) -> str:
    """Return the name under which Keras 3 stores a layer: its class in snake case, numbered from the second on."""
    letters = [
        "_" + letter.lower()
        if letter.isupper() and index and (kind[index - 1].islower() or kind[index + 1 : index + 2].islower())
        else letter.lower()
        for index, letter in enumerate(kind)
    ]
    name = "".join(letters)
    counts[name] = counts.get(name, -1) + 1
    return f"{name}_{counts[name]}" if counts[name] else name


def _variables(layers: h5py.Group, name: str) -> tuple[Floats, ...]:
    """Return a layer's weights as Keras 3 stores them."""
    variables = layers[name].get("vars", {}) if name in layers else {}
    return tuple(np.asarray(variables[number], np.float64) for number in sorted(variables, key=int))


def chain(path: Path, content: Any) -> list[tuple[str, str, dict[str, Any]]]:
    """Return class, name and options of each layer of an architecture, with those of networks in networks.

    Raises:
        UnusableModel: the layers are not a chain.
    """
    kind, config = content["class_name"], content["config"]
    if kind not in CONTAINERS:
        raise UnusableModel(f"{path}: a {kind}, not a network of one input and one output")
    layers = config if isinstance(config, list) else config["layers"]  # a list in Keras 1
    found: list[tuple[str, str, dict[str, Any]]] = []
    before = None
    for layer in layers:
        name = str(layer["config"].get("name") or layer.get("name"))
        origins = _origins(layer.get("inbound_nodes"))
        if kind != "Sequential" and before is not None and origins != [before]:
            raise UnusableModel(f"{path}: layer {name} does not follow {before}; only chains of layers are converted")
        if layer["class_name"] in CONTAINERS:
            raise UnusableModel(f"{path}: layer {name} is a network of its own; only chains of layers are converted")
        found.append((layer["class_name"], name, layer["config"]))
        before = name
    return found


def _origins(nodes: Any) -> list[str]:
    """Return the names of the layers whose outputs a layer takes: Keras 3 stores them as `keras_history`."""
    if isinstance(nodes, dict):
        if "keras_history" in nodes:
            return [str(nodes["keras_history"][0])]
        return [name for value in nodes.values() for name in _origins(value)]
    if isinstance(nodes, list):
        if len(nodes) >= 3 and isinstance(nodes[0], str) and isinstance(nodes[1], int):
            return [nodes[0]]
        return [name for value in nodes for name in _origins(value)]
    return []


def _check_size(path: Path, group: h5py.Group) -> None:
    """Refuse weights that would fill the memory: a small file can claim any size."""
    sizes: list[int] = []
    group.visititems(lambda _, item: sizes.append(item.nbytes) if isinstance(item, h5py.Dataset) else None)
    if sum(sizes) > LARGEST:
        raise UnusableModel(f"{path}: its weights claim {sum(sizes) >> 20} MB, more than {LARGEST >> 20}")
