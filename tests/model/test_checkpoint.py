import pickle
from pathlib import Path

import pytest
import torch

from pilot.files import write_atomically
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, UnusableModel, load_model, save_model


def saved(path: Path, name: str = "pilotnet") -> Model:
    model = Model(name, build_network(name, 1).eval(), {"epochs": 3}, {"rows": 7}, {"recorded": {"r2": 0.5}})
    save_model(path, model)
    return model


@pytest.mark.parametrize("name", ["pilotnet", "densenet"])
def test_a_loaded_model_steers_like_the_saved_one(tmp_path: Path, name: str) -> None:
    model = saved(tmp_path / "model.pt", name)
    loaded = load_model(tmp_path / "model.pt")
    frames = torch.randint(0, 256, (2, 160, 320, 3), dtype=torch.uint8)
    assert torch.equal(loaded.network(frames), model.network(frames))
    assert (loaded.name, loaded.config, loaded.data, loaded.metrics) == (name, model.config, model.data, model.metrics)
    assert not loaded.network.training


class Evil:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path("owned"),)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "damaged"),
        (b"not a model", "damaged"),
        (pickle.dumps({"a": 1}), "damaged"),
    ],
)
def test_files_that_are_no_model_are_refused(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "other.pt"
    path.write_bytes(content)
    with pytest.raises(UnusableModel, match=says) as error:
        load_model(path)
    assert "other.pt" in str(error.value)


def test_a_cut_off_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.pt"
    saved(path)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(UnusableModel, match="damaged"):
        load_model(path)


def test_a_file_that_wants_to_run_code_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    torch.save({"format": Evil()}, "evil.pt")
    with pytest.raises(UnusableModel):
        load_model(Path("evil.pt"))
    assert not Path("owned").exists()


def test_other_tensors_and_other_weights_are_refused(tmp_path: Path) -> None:
    torch.save({"weights": torch.zeros(3)}, tmp_path / "other.pt")
    with pytest.raises(UnusableModel, match="not a model of this program"):
        load_model(tmp_path / "other.pt")
    saved(tmp_path / "model.pt")
    content = torch.load(tmp_path / "model.pt", weights_only=True)
    torch.save({**content, "network": "lenet"}, tmp_path / "wrong.pt")
    with pytest.raises(UnusableModel, match="do not fit the network 'lenet'"):
        load_model(tmp_path / "wrong.pt")
    torch.save({**content, "network": "resnet"}, tmp_path / "newer.pt")
    with pytest.raises(UnusableModel, match="newer version"):
        load_model(tmp_path / "newer.pt")
    with pytest.raises(UnusableModel, match="no such file"):
        load_model(tmp_path / "absent.pt")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def fail(file: object) -> None:
        file.write(b"half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, fail)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
