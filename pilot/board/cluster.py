"""Drives of a suite on several machines, by Dask: an optional extra, `pip install distributed==2026.8.0`.

Every machine has this project installed; model files are sent to them. See docs/board.md.
"""

import functools
import hashlib
import tempfile
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

from pilot import process_settings
from pilot.board.suite import SUITES
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, run_together
from pilot.simulator.trajectory import Trajectory
from pilot.workers import WorkerKilledError

CONNECTING = 10  # seconds
START_WORKERS = "dask worker ADDRESS --nthreads 1 --nworkers -1"


class ClusterError(RuntimeError):
    """The cluster cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class SentModel:
    """A model file as it travels to another machine.

    Attributes:
        files: content by name: the model file first, then the description beside it, if there is one.
    """

    files: dict[str, bytes]

    @classmethod
    def read(cls, path: Path) -> "SentModel":
        """Read a model file and the description beside it.

        Raises:
            OSError: a file cannot be read.
        """
        beside = path.with_suffix(".json")
        return cls({each.name: each.read_bytes() for each in (path, beside) if each == path or each.exists()})

    def policy(self) -> ModelPolicy:
        """Return the model's steering policy; its files are written once in a process, to a temporary folder."""
        digest = hashlib.sha256(b"".join(self.files.values())).hexdigest()
        folder = Path(_temporary_folder().name) / digest
        if not folder.exists():
            folder.mkdir()
            for name, content in self.files.items():
                (folder / name).write_bytes(content)
        return ModelPolicy(folder / next(iter(self.files)))


@functools.cache
def _temporary_folder() -> "tempfile.TemporaryDirectory[str]":
    """Return a folder that is removed with the process."""
    return tempfile.TemporaryDirectory()


class Cluster:
    """Connection to the scheduler of a Dask cluster whose workers drive; a context manager.

    A worker that is lost during a drive is replaced by another one, which starts the drive again.
    """

    def __init__(self, address: str) -> None:
        """Connect.

        Args:
            address: of the scheduler, such as tcp://192.168.0.10:8786.

        Raises:
            ClusterError: Dask is not installed, there is no scheduler, no worker, or one that cannot be used.
        """
        try:
            import distributed  # noqa: PLC0415 - an optional extra
        except ImportError:
            raise ClusterError("--dask needs Dask: pip install distributed==2026.8.0") from None
        try:
            self._client = distributed.Client(address, timeout=CONNECTING, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(f"--dask {address}: no scheduler answers ({error}); start one: dask scheduler") from None
        try:
            self._check()
        except BaseException:
            self._client.close()
            raise

    def _check(self) -> None:
        """Check that there are workers, with a thread each and the same suites as here.

        Raises:
            ClusterError: it is not so.
        """
        threads = self._client.nthreads()
        if not threads:
            raise ClusterError(f"the cluster has no worker; start some on each machine: {START_WORKERS}")
        if several := [worker for worker, number in threads.items() if number > 1]:
            raise ClusterError(
                f"worker {several[0]} has several threads, and a process drives one car after the other; start it "
                f"again: {START_WORKERS}"
            )
        try:
            found = self._client.run(suite_digests)
        except Exception as error:
            raise ClusterError(f"a worker cannot drive ({error}); install this project on it: pip install .") from error
        for worker, digests in found.items():
            if digests != suite_digests():
                raise ClusterError(f"worker {worker} has another version of this project; install this one on it")

    def run(self, groups: Sequence[Sequence[DriveRequest]]) -> Generator[tuple[int, list[Trajectory]], None, None]:
        """Drive groups of episodes, each side by side in a worker.

        Args:
            groups: one or more requests each, as for `run_together`; all of one driver, without clips.

        Yields:
            The index of each group and its trajectories, in the order of completion.

        Raises:
            WorkerKilledError: several workers were killed while they drove the same group.
            Exception: any that `run_together` raises; the other groups are cancelled.
        """
        import distributed  # noqa: PLC0415 - an optional extra

        driver = groups[0][0].driver
        model = self._client.scatter(SentModel.read(driver.path)) if isinstance(driver, ModelPolicy) else None
        numbers = {
            self._client.submit(drive_group, model, group, pure=False): number for number, group in enumerate(groups)
        }
        try:
            for future, trajectories in distributed.as_completed(numbers, self._client.loop, with_results=True):
                yield numbers[future], trajectories
        except distributed.KilledWorker as error:
            raise WorkerKilledError(f"workers of the cluster were killed: {error}") from error
        finally:
            self._client.cancel(list(numbers))

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        self._client.close()


# In the workers


def drive_group(model: SentModel | None, requests: Sequence[DriveRequest]) -> list[Trajectory]:
    """Drive episodes side by side in this process, with a model that was sent (None: with the requests' driver).

    Raises:
        ValueError, UnusableModel, RuntimeError: as for `run_together`.
    """
    process_settings.for_driving()
    if model:
        policy = model.policy()
        requests = [replace(request, driver=policy) for request in requests]
    return run_together(requests)


def suite_digests() -> dict[str, Any]:
    """Return the digests of the suites as this process knows them."""
    return {version: suite.digest for version, suite in SUITES.items()}
