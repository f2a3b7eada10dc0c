"""Models as ONNX files: the same steering as the original, and networks of other projects."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from pilot.commands import evaluate, export
from pilot.driving.driver import Driver
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, UnusableModel, load_model, save_model
from pilot.portable.comparison import inputs_of
from pilot.portable.onnx_export import export_model
from pilot.portable.onnx_model import load_onnx, onnx_model
from pilot.portable.resize import integer_weights

Frames = np.ndarray


@pytest.fixture(scope="module")
def frames() -> Frames:
    return np.random.default_rng(0).integers(0, 256, (4, 160, 320, 3), np.uint8)


def model_of(network: str) -> Model:
    torch.manual_seed(0)
    return Model(network, build_network(network).eval(), {"recipe": "real"}, {"rows": 7}, {"r2": 0.5})


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with model.pt, and with model.onnx that the command has written."""
    folder = tmp_path_factory.mktemp("exported")
    save_model(folder / "model.pt", model_of("pilotnet"))
    recording = folder / "recording"
    recording.mkdir()
    assert export.main([str(folder / "model.pt"), "--int8"]) == 0
    return folder


@pytest.mark.parametrize("network", ["pilotnet_standardised", "simplenet"])
def test_an_exported_network_steers_as_the_original(network: str, frames: Frames) -> None:
    model = model_of(network)
    onnx_form = onnx_model(Path("model.onnx"), export_model(model).SerializeToString())
    with torch.inference_mode():
        expected = model.network(torch.from_numpy(frames)).numpy()
    assert np.abs(expected - [onnx_form.predict(frame)[0] for frame in frames]).max() < 1e-5


@pytest.mark.parametrize("network", ["pilotnet_ahead", "pilotnet_history", "pilotnet_plan", "pilotnet_speed"])
def test_all_outputs_of_a_network_are_exported(network: str, frames: Frames, tmp_path: Path) -> None:
    model = model_of(network)
    (tmp_path / "model.onnx").write_bytes(export_model(model).SerializeToString())
    original, copy = Driver(model), Driver.load(tmp_path / "model.onnx")
    assert copy.signature == original.signature == model.network.signature
    for seen in inputs_of(list(frames), copy.signature):
        np.testing.assert_allclose(copy.predict(seen), original.predict(seen), atol=1e-5)
        assert copy(seen).horizons == original(seen).horizons
        assert (copy(seen).speed is not None) == original.signature.speed


def test_a_damaged_signature_is_refused(tmp_path: Path) -> None:
    converted = export_model(model_of("pilotnet_ahead"))
    [entry] = converted.metadata_props
    entry.value = entry.value.replace('"horizons": [0.0', '"horizons": ["soon"')
    (tmp_path / "model.onnx").write_bytes(converted.SerializeToString())
    with pytest.raises(UnusableModel, match=r"model\.onnx: "):
        load_onnx(tmp_path / "model.onnx")


@pytest.mark.parametrize(("before", "after"), [(320, 200), (65, 66), (76, 128), (320, 128), (100, 31)])
def test_the_integer_weights_resize_to_the_bit_of_pytorch(before: int, after: int) -> None:
    pixels = torch.randint(0, 256, (1, 1, 7, before), dtype=torch.uint8)
    expected = torch.nn.functional.interpolate(pixels, (7, after), mode="bilinear", antialias=True)
    weights, bits = integer_weights(before, after)
    got = np.clip(np.floor((pixels.numpy().astype(np.float64) @ weights.T + 2.0 ** (bits - 1)) / 2.0**bits), 0, 255)
    assert np.array_equal(got, expected.numpy())


def test_the_command_writes_a_model_that_drives_as_the_original(exported: Path, frames: Frames) -> None:
    original, copy = Driver.load(exported / "model.pt"), Driver.load(exported / "model.onnx")
    assert copy.steer(frames[0]) == pytest.approx(original.steer(frames[0]), abs=1e-5)
    assert (copy.model.name, copy.model.config) == ("pilotnet", {"recipe": "real"})
    assert load_onnx(exported / "model.int8.onnx").predict(frames[0])[0] == pytest.approx(
        copy.predict(frames[0])[0], abs=0.1
    )


def test_an_onnx_file_is_evaluated_like_a_model(
    exported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(exported / "model.pt"), str(exported / "model.onnx")]
    options = ["--tracks", "random:3", "--laps", "0.01", "--jobs", "1", "--out", str(tmp_path)]
    assert evaluate.main([files[0], *options]) == 0
    printed = capsys.readouterr().out
    assert evaluate.main([files[1], *options]) == 0
    assert capsys.readouterr().out == printed


def test_a_training_does_not_start_from_an_onnx_file(exported: Path) -> None:
    with pytest.raises(UnusableModel, match=r"model\.onnx: an ONNX file only steers; give the \.pt file"):
        load_model(exported / "model.onnx")


def test_nothing_is_written_if_the_copy_steers_otherwise(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pilot.portable.onnx_export.TOLERANCE", -1.0)
    assert export.main([str(exported / "model.pt"), "--out", str(tmp_path / "copy.onnx")]) == 1
    assert "differently from the original; it was not written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["model.txt"], "model.txt: must be a .pt"),
        (["model.pt", "--out", "model.pt"], "must end with .onnx"),
        (["model.onnx"], "would be overwritten"),
        (["model.pt", "--preprocessing", "x.json"], "contains its own"),
        (["missing.pt"], "missing.pt: no such file"),
        (["missing.h5"], "missing.h5: no such file"),
    ],
)
def test_wrong_arguments_of_the_export(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert export.main(arguments) == 1
    assert message in capsys.readouterr().err


# Networks of other projects


def foreign(*, shape: tuple[int | str, ...] = ("n", 66, 200, 3), outputs: int = 1) -> onnx.ModelProto:
    """A network whose value k is k + the mean of all pixels."""
    nodes = [
        helper.make_node("ReduceMean", ["image", "axes"], ["mean"], keepdims=0),
        helper.make_node("Add", ["mean", "numbers"], ["values"]),
    ]
    axes = numpy_helper.from_array(np.array([1, 2, 3], np.int64), "axes")
    numbers = numpy_helper.from_array(np.arange(outputs, dtype=np.float32), "numbers")
    inputs = [helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)]
    values = [helper.make_tensor_value_info("values", TensorProto.FLOAT, None)]
    graph = helper.make_graph(nodes, "foreign", inputs, values, [axes, numbers])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)


STEPS = [
    {"crop": {"top": 60, "bottom": 25}},
    {"resize": {"height": 66, "width": 200}},
    {"colours": "YUV"},
    {"scale": {"divide": 127.5, "subtract": 1}},
]


def write(folder: Path, model: onnx.ModelProto, description: object = None) -> Path:
    path = folder / "foreign.onnx"
    onnx.save(model, path)
    if description is not None:
        path.with_suffix(".json").write_text(json.dumps(description))
    return path


def test_a_network_of_another_project_steers_by_its_description(tmp_path: Path, frames: Frames) -> None:
    description = {"steps": STEPS, "steering": {"output": 1, "multiply": 0.5}}
    steer = load_onnx(write(tmp_path, foreign(outputs=2), description)).predict
    image = cv2.cvtColor(cv2.resize(frames[0][60:-25], (200, 66)), cv2.COLOR_RGB2YUV) / 127.5 - 1
    assert steer(frames[0])[0] == pytest.approx(0.5 * (1 + image.mean()), abs=1e-5)


def test_images_of_pytorchs_order(tmp_path: Path, frames: Frames) -> None:
    description = {"steps": [{"crop": {"left": 20, "right": 100}}], "layout": "NCHW"}
    steer = load_onnx(write(tmp_path, foreign(shape=(1, 3, 160, 200)), description)).predict
    assert steer(frames[0])[0] == pytest.approx(frames[0][:, 20:-100].mean(), rel=1e-5)


def test_the_export_puts_a_description_into_the_file(tmp_path: Path, frames: Frames) -> None:
    path = write(tmp_path, foreign(), {"steps": STEPS})
    described = tmp_path / "described.onnx"
    options = ["--preprocessing", str(path.with_suffix(".json")), "--out", str(described)]
    assert export.main([str(path), *options]) == 0
    expected = load_onnx(path).predict(frames[0])[0]
    path.with_suffix(".json").unlink()
    assert load_onnx(described).predict(frames[0])[0] == expected


Spoil = Callable[[onnx.ModelProto], object]


def lies_elsewhere(model: onnx.ModelProto) -> None:
    tensor = model.graph.initializer[1]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    entry = tensor.external_data.add()
    entry.key, entry.value = "location", "/etc/passwd"


def has_an_operator_of_its_own(model: onnx.ModelProto) -> None:
    model.graph.node[0].domain = "some.project"
    model.opset_import.append(helper.make_opsetid("some.project", 1))


@pytest.mark.parametrize(
    ("spoil", "description", "message"),
    [
        (None, None, r"foreign\.json beside it, such as"),
        (None, {"steps": STEPS[:1]}, r"takes \['n', 66, 200, 3\], but the described preprocessing gives"),
        (None, {"steps": [{"rotate": 5}]}, r"step \{'rotate': 5\}: must have one entry, of blur, colours, crop"),
        (None, {"steps": [{"crop": {"top": -1}}]}, r"crop top -1: must be a number in 0\.\."),
        (None, {"steps": [{"crop": {"top": 159, "bottom": 3}}]}, r"nothing is left of 160x320"),
        (None, {"steps": [{"colours": "gray"}, {"colours": "YUV"}]}, r"cannot be applied to the result"),
        (None, {"steps": STEPS, "order": 1}, r"no 'order'; there are lambdas, layout, steering, steps"),
        (None, {"steps": STEPS, "steering": {"output": 1}}, r"steering output 1: there are fewer values"),
        (lies_elsewhere, {"steps": STEPS}, r"its weights lie in other files"),
        (has_an_operator_of_its_own, {"steps": STEPS}, r"ONNX Runtime cannot use it"),
    ],
)
def test_what_cannot_be_used_is_said(spoil: Spoil | None, description: object, message: str, tmp_path: Path) -> None:
    model = foreign()
    if spoil:
        spoil(model)
    with pytest.raises(UnusableModel, match=message):
        load_onnx(write(tmp_path, model, description))


def test_a_cut_file_is_refused(exported: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.onnx"
    path.write_bytes((exported / "model.onnx").read_bytes()[:-1000])
    with pytest.raises(UnusableModel, match=r"cut\.onnx: damaged, or not an ONNX file"):
        load_onnx(path)
