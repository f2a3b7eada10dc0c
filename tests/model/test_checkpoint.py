import contextlib
import pickle
import resource
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from pilot.files import write_atomically
from pilot.model.build import build_network
from pilot.model.checkpoint import FORMAT, Model, UnusableModel, load_model, save_model


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
    with pytest.raises(UnusableModel, match="not a behavioral-cloning steering model"):
        load_model(tmp_path / "other.pt")
    saved(tmp_path / "model.pt")
    content = torch.load(tmp_path / "model.pt", weights_only=True)
    del content["sha256"]
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


def test_a_single_changed_bit_is_noticed(tmp_path: Path) -> None:
    path, changed = tmp_path / "model.pt", tmp_path / "changed.pt"
    model = saved(path, "lenet")
    content = path.read_bytes()
    random = np.random.default_rng(1)
    for position in random.integers(len(content), size=300):
        damaged = bytearray(content)
        damaged[position] ^= 1 << random.integers(8)
        changed.write_bytes(damaged)
        with contextlib.suppress(UnusableModel):  # loaded: the bit was in the padding between two records
            assert same_weights(load_model(changed), model)


def same_weights(first: Model, second: Model) -> bool:
    states = first.network.state_dict(), second.network.state_dict()
    return all(torch.equal(value, states[1][key]) for key, value in states[0].items())


def test_weights_changed_together_with_the_archives_checksum_are_refused(tmp_path: Path) -> None:
    saved(tmp_path / "model.pt")
    content = torch.load(tmp_path / "model.pt", weights_only=True)
    next(iter(content["weights"].values())).view(-1)[0] += 1
    torch.save(content, tmp_path / "changed.pt")
    with pytest.raises(UnusableModel, match=r"changed.pt: damaged"):
        load_model(tmp_path / "changed.pt")


def test_weights_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    network = build_network("pilotnet", 1)
    next(network.parameters()).data[0] = torch.nan
    save_model(tmp_path / "model.pt", Model("pilotnet", network, {}, {}, {}))
    with pytest.raises(UnusableModel, match=r"model.pt: its weights are not finite"):
        load_model(tmp_path / "model.pt")


@pytest.mark.parametrize(("key", "value"), [("config", None), ("weights", [1]), ("version", "1"), ("network", {})])
def test_a_part_of_the_wrong_type_is_named(tmp_path: Path, key: str, value: object) -> None:
    saved(tmp_path / "model.pt")
    content = torch.load(tmp_path / "model.pt", weights_only=True)
    del content["sha256"]
    torch.save({**content, key: value}, tmp_path / "wrong.pt")
    with pytest.raises(UnusableModel, match=f"no valid '{key}'"):
        load_model(tmp_path / "wrong.pt")


def test_files_that_would_fill_the_memory_are_refused_before_they_do(tmp_path: Path) -> None:
    giant = torch.zeros(1).expand(1 << 40)  # one number in the file
    save = {"format": FORMAT, "sha256": "0", "weights": {"a": giant}}
    torch.save(save, tmp_path / "repeated.pt")
    torch.save({"format": FORMAT, "weights": {"a": torch.zeros(1000)}}, tmp_path / "small.pt")
    copy_archive(tmp_path / "small.pt", tmp_path / "compressed.pt", zipfile.ZIP_DEFLATED)
    longer = (b"M" + struct.pack("<H", 1000), b"J" + struct.pack("<i", 2_000_000_000))  # the pickled number of elements
    copy_archive(tmp_path / "small.pt", tmp_path / "declared.pt", zipfile.ZIP_STORED, longer)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in ("repeated", "compressed", "declared"):
        with pytest.raises(UnusableModel, match=f"{name}.pt: damaged"):
            load_model(tmp_path / f"{name}.pt")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def copy_archive(source: Path, target: Path, compression: int, replaced: tuple[bytes, bytes] = (b"", b"")) -> None:
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w", compression) as new:
        for name in old.namelist():
            content = old.read(name)
            assert not name.endswith("data.pkl") or replaced[0] in content
            new.writestr(name, content.replace(*replaced) if replaced[0] else content)
