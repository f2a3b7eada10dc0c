"""Keras files of all versions as ONNX: the same output as Keras, without Keras, and without executing anything."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
from conftest import REPOSITORY, Recording, picture

from pilot.commands import export
from pilot.model.checkpoint import UnusableModel
from pilot.portable.keras_file import read_keras
from pilot.portable.keras_network import input_size, keras_network
from pilot.portable.onnx_model import load_onnx
from pilot.portable.preprocessing import WrongDescription

KERAS_1 = [
    ("Lambda", {"batch_input_shape": [None, 66, 200, 3], "function": ["4wEAAAAB", None, None]}, {}),
    (
        "Convolution2D",
        {"nb_filter": 2, "subsample": [2, 2], "border_mode": "valid", "activation": "relu", "dim_ordering": "tf"},
        {"W": (5, 5, 3, 2), "b": (2,)},
    ),
    ("MaxPooling2D", {"pool_size": [3, 3], "strides": [3, 3], "border_mode": "valid"}, {}),
    ("Flatten", {}, {}),
    ("Dropout", {"p": 0.5}, {}),
    ("Dense", {"output_dim": 1, "activation": "linear"}, {"W": (10 * 32 * 2, 1), "b": (1,)}),
]
LAMBDAS = {"lambda_1": {"scale": {"divide": 127.5, "subtract": 1}}}


def write_keras_1(
    path: Path, *, architecture_inside: bool = True, layers: list[Any] = KERAS_1
) -> dict[str, np.ndarray]:
    """Write a file as Keras 1 did in 2016 with random weights; returns them by name."""
    random = np.random.default_rng(0)
    configs, stored = [], {}
    with h5py.File(path, "w") as file:
        groups = file.create_group("model_weights") if architecture_inside else file
        for kind, config, shapes in layers:
            name = f"{kind.lower()}_1"
            configs.append({"class_name": kind, "config": {"name": name, **config}})
            group = groups.create_group(name)
            names = [f"{name}_{letter}:0" for letter in shapes]
            group.attrs["weight_names"] = [full.encode() for full in names]
            for full, shape in zip(names, shapes.values(), strict=True):
                stored[full] = random.normal(0, 0.1, shape).astype(np.float32)
                group[full] = stored[full]
        content = json.dumps({"class_name": "Sequential", "config": configs})
        if architecture_inside:
            file.attrs["model_config"] = content.encode()
        else:
            path.with_suffix(".json").write_text(json.dumps(content))  # twice, as json.dump(model.to_json()) does
    return stored


def by_hand(image: np.ndarray, weights: dict[str, np.ndarray]) -> float:
    """What the network of `KERAS_1` computes, from the definition of its layers."""
    scaled = image / 127.5 - 1
    windows = np.lib.stride_tricks.sliding_window_view(scaled, (5, 5), axis=(0, 1))[::2, ::2]  # 31 x 98 x 3 x 5 x 5
    maps = np.einsum("rcipq,pqio->rco", windows, weights["convolution2d_1_W:0"]) + weights["convolution2d_1_b:0"]
    maps = np.maximum(maps, 0)[:30, :96].reshape(10, 3, 32, 3, 2).max((1, 3))
    return float(maps.reshape(-1) @ weights["dense_1_W:0"][:, 0] + weights["dense_1_b:0"][0])


@pytest.mark.parametrize("architecture_inside", [True, False])
def test_a_file_of_2016(architecture_inside: bool, tmp_path: Path) -> None:
    weights = write_keras_1(tmp_path / "model.h5", architecture_inside=architecture_inside)
    layers = read_keras(tmp_path / "model.h5")
    image = np.random.default_rng(1).integers(0, 256, (66, 200, 3)).astype(np.float32)
    output = keras_network(layers, LAMBDAS)(torch.from_numpy(image[None]))
    assert input_size(layers) == (66, 200, 3)
    assert float(output.detach()) == pytest.approx(by_hand(image, weights), rel=1e-4)


def test_the_command_converts_it_with_its_preprocessing(tmp_path: Path) -> None:
    weights = write_keras_1(tmp_path / "model.h5")
    steps = [{"crop": {"top": 60, "bottom": 34}}, {"crop": {"left": 60, "right": 60}}]
    description = tmp_path / "preprocessing.json"
    description.write_text(json.dumps({"steps": steps, "steering": {"multiply": 0.1}, "lambdas": LAMBDAS}))
    assert export.main([str(tmp_path / "model.h5"), "--preprocessing", str(description)]) == 0
    frame = np.random.default_rng(2).integers(0, 256, (160, 320, 3), np.uint8)
    expected = 0.1 * by_hand(frame[60:126, 60:260].astype(np.float64), weights)
    assert load_onnx(tmp_path / "model.onnx").predict(frame)[0] == pytest.approx(expected, rel=1e-4)


def test_a_lambda_is_not_executed_but_must_be_described(tmp_path: Path) -> None:
    write_keras_1(tmp_path / "model.h5")
    with pytest.raises(WrongDescription, match=r'lambda_1: a Lambda contains Python code.*"lambdas": \{"lambda_1"'):
        keras_network(read_keras(tmp_path / "model.h5"), {})


def test_a_layer_that_is_not_converted_is_named(tmp_path: Path) -> None:
    write_keras_1(tmp_path / "model.h5", layers=[*KERAS_1[1:3], ("LSTM", {}, {})])
    with pytest.raises(WrongDescription, match=r"layer lstm_1: a LSTM is not converted; there are Conv2D"):
        keras_network(read_keras(tmp_path / "model.h5"), {})


def test_weights_without_an_architecture(tmp_path: Path) -> None:
    write_keras_1(tmp_path / "model.h5", architecture_inside=False)
    (tmp_path / "model.json").unlink()
    with pytest.raises(UnusableModel, match=r"weights only; put the architecture beside it, as model\.json"):
        read_keras(tmp_path / "model.h5")


def test_a_damaged_file(tmp_path: Path) -> None:
    write_keras_1(tmp_path / "model.h5")
    (tmp_path / "model.h5").write_bytes((tmp_path / "model.h5").read_bytes()[:3000])
    with pytest.raises(UnusableModel, match=r"model\.h5: damaged, or not a Keras file"):
        read_keras(tmp_path / "model.h5")


def test_weights_that_would_fill_the_memory(tmp_path: Path) -> None:
    write_keras_1(tmp_path / "model.h5")
    with h5py.File(tmp_path / "model.h5", "a") as file:
        file.create_dataset("model_weights/huge", (1 << 20, 1 << 20), np.float32, chunks=(1024, 1024))
    with pytest.raises(UnusableModel, match=r"its weights claim 4194304 MB"):
        read_keras(tmp_path / "model.h5")


TRAINING = """
import sys, numpy, keras
from keras import layers
kept = keras.Sequential([
    layers.Input((66, 200, 3)), layers.Rescaling(1 / 127.5, offset=-1.0),
    layers.Conv2D(8, 5, strides=2, activation="elu"), layers.BatchNormalization(),
    layers.Conv2D(8, 3, padding="same", strides=2), layers.ELU(), layers.MaxPooling2D(), layers.Flatten(),
    layers.Dense(10, activation="tanh"), layers.Dropout(0.5), layers.Dense(1),
])
images = numpy.random.default_rng(0).uniform(0, 255, (64, 66, 200, 3)).astype("float32")
kept.compile("adam", "mse")
kept.fit(images, images[:, 30, 100, :1] / 255, epochs=2, verbose=0)
numpy.savez("known.npz", images=images[:8], outputs=kept.predict(images[:8], verbose=0))
kept.save("model.keras")
kept.save("model.h5")
kept.save_weights("alone.weights.h5")
open("alone.json", "w").write(kept.to_json())
"""


@pytest.fixture
def _tensorflow() -> None:
    """Keras trains in another process: TensorFlow changes settings of the whole process."""
    pytest.importorskip("keras", reason="needs Keras and TensorFlow: pip install tensorflow-cpu")
    pytest.importorskip("tensorflow", reason="needs TensorFlow: pip install tensorflow-cpu")


@pytest.mark.usefixtures("_tensorflow")
def test_a_freshly_trained_network(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-W", "ignore", "-c", TRAINING], cwd=tmp_path, check=True, capture_output=True)
    known = np.load(tmp_path / "known.npz")
    for name in ("model.keras", "model.h5", "alone.weights.h5"):
        with torch.inference_mode():
            got = keras_network(read_keras(tmp_path / name), {})(torch.from_numpy(known["images"]))
        assert np.abs(got.numpy() - known["outputs"]).max() < 1e-5, name


@pytest.mark.usefixtures("_tensorflow")
def test_the_example_trains_on_a_recording_what_can_be_converted(recording: Recording, tmp_path: Path) -> None:
    example = REPOSITORY / "examples/train_keras.py"
    command = [sys.executable, str(example), str(recording()), "--epochs", "10", "--correction", "0"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert export.main([str(tmp_path / "nvidia.keras")]) == 0
    predict = load_onnx(tmp_path / "nvidia.onnx").predict
    left, right = (predict(picture(steering))[0] for steering in (-0.5, 0.5))
    assert right - left > 0.1
