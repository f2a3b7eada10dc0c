"""Measuring models by a suite, and the results as files: what is measured is not measured again."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from pilot import process_settings
from pilot.board.maps import draw_maps
from pilot.board.points import DrivePoints, judge
from pilot.board.suite import Suite
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, PolicyFactory, expert_policy, run_together
from pilot.files import write_atomically
from pilot.portable.loading import load
from pilot.simulator.catalogue import load_track
from pilot.simulator.track import REVERSED
from pilot.simulator.trajectory import Trajectory
from pilot.training.plots import save
from pilot.workers import run_tasks

EXPERT = "expert"
# drives groups of episodes, each side by side; yields the index and the trajectories of each group when it is done
Engine = Callable[[Sequence[Sequence[DriveRequest]]], Iterator[tuple[int, list[Trajectory]]]]


@dataclass(frozen=True)
class Contestant:
    """A driver to be measured.

    Attributes:
        name: in the table and of its files.
        path: of the model file; None: the expert.
    """

    name: str
    path: Path | None

    @property
    def driver(self) -> PolicyFactory:
        """Makes the steering policy."""
        return ModelPolicy(self.path) if self.path else expert_policy

    @property
    def digest(self) -> str:
        """SHA-256 of the model file."""
        return hashlib.sha256(self.path.read_bytes()).hexdigest() if self.path else EXPERT

    @property
    def network(self) -> str:
        """Name of the network.

        Raises:
            UnusableModel: the model cannot be loaded.
        """
        return load(self.path).name if self.path else "knows the road"

    def check(self) -> None:
        """Load the model, if it is one.

        Raises:
            UnusableModel: it cannot be loaded.
        """
        if self.path:
            load(self.path)


@dataclass(frozen=True)
class Result:
    """A driver's result in a suite.

    Attributes:
        name: of the driver.
        network: name of its network.
        suite: version and digest of the suite.
        model: SHA-256 of the model file.
        drives: the figures of each drive.
    """

    name: str
    network: str
    suite: tuple[str, str]
    model: str
    drives: tuple[DrivePoints, ...]


def in_processes(jobs: int | None = None) -> Engine:
    """Return an engine of worker processes of this machine; None: one per core."""

    def run(groups: Sequence[Sequence[DriveRequest]]) -> Iterator[tuple[int, list[Trajectory]]]:
        return run_tasks(run_together, groups, jobs, process_settings.for_driving)

    return run


def measure_all(
    suite: Suite, contestants: Sequence[Contestant], folder: Path, engine: Engine, *, clips: bool = False
) -> None:
    """Measure drivers, each unless the folder has its result; writes a result and a picture of maps for each.

    Args:
        suite: the drives.
        contestants: the drivers.
        folder: of the results.
        engine: drives; `in_processes`, or that of a cluster.
        clips: also make a clip of each drive, on the machine that drives.

    Raises:
        UnusableModel: a model cannot be loaded.
        OSError: a file cannot be written.
    """
    identity = (suite.version, suite.digest)
    networks = {contestant.name: contestant.network for contestant in contestants}  # before minutes of driving
    for contestant in contestants:
        known = read_result(result_file(folder, contestant.name))
        if known and (known.suite, known.model) == (identity, contestant.digest):
            continue
        trajectories = drive(suite, contestant, engine, folder if clips else None)
        drives = tuple(
            judge(each.title, load_track(each.track), trajectory)
            for each, trajectory in zip(suite.drives, trajectories, strict=True)
        )
        save(draw_maps(contestant.name, suite, trajectories), folder / f"{contestant.name}.png")
        result = Result(contestant.name, networks[contestant.name], identity, contestant.digest, drives)
        write_result(result_file(folder, contestant.name), result)


def drive(suite: Suite, contestant: Contestant, engine: Engine, clips: Path | None) -> list[Trajectory]:
    """Drive all of a suite, with clips if their folder is given; returns the trajectories in its order."""
    requests = [
        each.request(contestant.driver, clip_file(clips, contestant.name, number) if clips else None)
        for number, each in enumerate(suite.drives)
    ]
    groups = [[number] for number in range(len(requests))] if clips else in_one_scene(requests)
    trajectories: dict[int, Trajectory] = {}
    with tqdm(total=len(requests), desc=contestant.name, unit=" drives", leave=False) as bar:
        for group, driven in engine([[requests[number] for number in group] for group in groups]):
            trajectories.update(zip(groups[group], driven, strict=True))
            bar.update(len(driven))
    return [trajectories[number] for number in range(len(requests))]


def in_one_scene(requests: Sequence[DriveRequest]) -> list[list[int]]:
    """Return groups of the drives in one scene, which is built once for them; the longest first."""
    groups: dict[tuple[str, str | None], list[int]] = {}
    for number, request in enumerate(requests):
        groups.setdefault((request.track.removesuffix(REVERSED), request.light), []).append(number)
    return sorted(groups.values(), key=len, reverse=True)


# Files


def result_file(folder: Path, name: str) -> Path:
    """Return the path of a driver's result."""
    return folder / f"{name}.json"


def clip_file(folder: Path, name: str, number: int) -> Path:
    """Return the path of the clip of a driver's drive with a number."""
    return folder / name / f"{number:02}.mp4"


def write_result(path: Path, result: Result) -> None:
    """Write a result, atomically.

    Raises:
        OSError: the file cannot be written.
    """
    text = json.dumps(dataclasses.asdict(result), indent=1)
    write_atomically(path, lambda file: file.write(text.encode()))


def read_result(path: Path) -> Result | None:
    """Read a result; None: there is none, or it cannot be read."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        drives = tuple(DrivePoints(**each) for each in content["drives"])
        version, digest = content["suite"]
        return Result(content["name"], content["network"], (version, digest), content["model"], drives)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def results_in(folder: Path, suite: Suite) -> Iterator[Result]:
    """Yield the results of a suite in a folder, from earlier measurements too."""
    identity = (suite.version, suite.digest)
    for path in sorted(folder.glob("*.json")):
        result = read_result(path)
        if result and result.suite == identity and len(result.drives) == len(suite.drives):
            yield result
