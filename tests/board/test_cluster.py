"""A suite on a Dask cluster: two workers drive as the processes of one machine do."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from pilot import process_settings
from pilot.board.cluster import Cluster, ClusterError, SentModel
from pilot.board.measurement import Contestant, Engine, in_processes, measure_all, read_result, result_file
from pilot.board.suite import SUITES, Suite
from pilot.commands import evaluate

distributed = pytest.importorskip("distributed", reason="needs Dask: pip install distributed")
pytestmark = pytest.mark.filterwarnings("default")  # Dask's own

MODEL = Path(__file__).parents[2] / "models" / "built_in.pt"
SMALL = Suite("small", tuple(replace(drive, metres=8.0) for drive in SUITES["v1"].drives[:3]), "on short roads")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster.scheduler_address


def test_two_workers_measure_what_one_process_does(address: str, tmp_path: Path) -> None:
    def measured(engine: Engine, folder: Path) -> object:
        folder.mkdir()
        measure_all(SMALL, [Contestant("ours", MODEL), Contestant("expert", None)], folder, engine)
        return [read_result(result_file(folder, name)) for name in ("ours", "expert")]

    with Cluster(address) as cluster:
        on_cluster = measured(cluster.run, tmp_path / "cluster")
    process_settings.for_driving()  # as in the workers: more threads round differently
    assert on_cluster == measured(in_processes(1), tmp_path / "here")


def test_a_worker_that_is_lost_is_replaced(address: str, tmp_path: Path) -> None:
    def losing_one(groups):
        for number, trajectories in cluster.run(groups):
            if number == 0:  # while the others are driven
                cluster._client.run(os._exit, 1, workers=[next(iter(cluster._client.nthreads()))], on_error="ignore")
            yield number, trajectories

    with Cluster(address) as cluster:
        measure_all(SMALL, [Contestant("ours", MODEL)], tmp_path, losing_one)
        cluster._client.wait_for_workers(2)
    result = read_result(result_file(tmp_path, "ours"))
    assert result is not None
    assert len(result.drives) == 3


def test_a_model_travels_with_its_description(tmp_path: Path) -> None:
    (tmp_path / "theirs.onnx").write_bytes(b"network")
    (tmp_path / "theirs.json").write_bytes(b"description")
    arrived = SentModel.read(tmp_path / "theirs.onnx").policy().path
    assert arrived.parent != tmp_path
    assert (arrived.name, arrived.read_bytes()) == ("theirs.onnx", b"network")
    assert arrived.with_suffix(".json").read_bytes() == b"description"


def test_a_worker_with_several_threads_is_refused() -> None:
    options = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options) as cluster, pytest.raises(ClusterError, match="--nthreads 1"):
        Cluster(cluster.scheduler_address)


def test_no_scheduler(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("pilot.board.cluster.CONNECTING", 0.2)
    assert evaluate.main(["expert", "--suite", "v1", "--dask", "tcp://127.0.0.1:9"]) == 1
    assert "start one: dask scheduler" in capsys.readouterr().err
    assert evaluate.main(["expert", "--dask", "tcp://127.0.0.1:9"]) == 1
    assert "--dask: goes with --suite" in capsys.readouterr().err
