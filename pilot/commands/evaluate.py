"""Evaluation of how well models drive: python evaluate.py model.pt (see --help)."""

import operator
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from pilot import cli, process_settings
from pilot.evaluation.conditions import Conditions, expand_tracks
from pilot.terminal import show

if TYPE_CHECKING:
    from pilot.board.measurement import Contestant
    from pilot.board.suite import Suite
    from pilot.evaluation.closed_loop import PolicyFactory
    from pilot.evaluation.scenarios import Scenario
    from pilot.evaluation.table import Evaluation
    from pilot.simulator.trajectory import Trajectory

PROGRAM = cli.program("evaluate.py")
EXPERT = Path("expert")  # given instead of a model file: the built-in simulator's expert


@dataclass(frozen=True)
class EvaluationConfig:
    """Evaluate how well models drive in the built-in simulator, or in replays of recordings.

    The car is put back whenever it leaves the road. The same options give the same scores.
    """

    models: tyro.conf.Positional[tuple[Path, ...]]
    """Model files, such as model.pt, or ONNX files; `expert`: the expert driver that records the demonstrations."""
    tracks: tuple[str, ...] = ()
    """lake, jungle, mountain, random:SEED, or a range such as random:0-49; "lake reversed": in the other direction.
    Default without --recordings: the three named tracks in both directions, and random:0-4."""
    lights: tuple[Literal["noon", "clear", "evening", "overcast"], ...] = ()
    """Lights in which each track is driven. Default: the track's own."""
    seeds: tuple[int, ...] = ()
    """Seeds of random start positions, one episode each. Default: the start line."""
    suite: Literal["v1", "long-v1", "latency-v1"] | None = None
    """Measure by a frozen suite of drives instead, with one score, and write the page board.html: docs/board.md."""
    conditions: tyro.conf.OmitArgPrefixes[Conditions] = field(default_factory=Conditions)
    recordings: tuple[Path, ...] = ()
    """Recordings to replay, with the frames warped to the position of the car that the model steers."""
    last_part: float = 1.0
    """Replay only this last share (0..1) of each recording; model.py --samples.first-part trains on the rest."""
    socket: bool = False
    """Drive through drive.py and its socket instead of in this process; the latency is then that of the protocol."""
    jobs: int | None = None
    """Number of processes, which share the episodes and replays. Default: one per core."""
    dask: str | None = None
    """With --suite: address of a Dask scheduler, such as tcp://192.168.0.10:8786, whose workers drive."""
    out: Path = Path("evaluation")
    """Folder for scores.json and the figures."""
    video: bool = False
    """Also make a clip of each episode or replay."""

    @property
    def driven_tracks(self) -> list[str]:
        """Names of the tracks to drive, with ranges expanded.

        Raises:
            ValueError: a range is empty or too large.
        """
        return expand_tracks(self.tracks or ([] if self.recordings else default_tracks()))

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        self.conditions.check()
        if not self.models:
            raise ValueError("no model given; for example: python evaluate.py model.pt")
        if self.jobs is not None and self.jobs < 1:
            raise ValueError(f"--jobs {self.jobs}: must be at least 1")
        if min(self.seeds, default=0) < 0:
            raise ValueError(f"--seeds {min(self.seeds)}: must not be negative")
        if self.socket and (self.conditions.latency_ms, self.conditions.lost_frames) != (
            Conditions.latency_ms,
            Conditions.lost_frames,
        ):
            raise ValueError("--socket: --latency-ms and --lost-frames are for drives without it")
        if EXPERT in self.models and (self.socket or self.recordings):
            raise ValueError("the expert knows the road of the built-in simulator: not with --socket or --recordings")
        self._check_suite()
        if not 0 < self.last_part <= 1:
            raise ValueError(f"--last-part {self.last_part:g}: must be greater than 0, and at most 1")

    def _check_suite(self) -> None:
        allowed = EvaluationConfig(
            self.models, suite=self.suite, jobs=self.jobs, dask=self.dask, out=self.out, video=self.video
        )
        if self.suite and self != allowed:
            raise ValueError(
                "--suite: has its own tracks and conditions; only --jobs, --dask, --out and --video go with it"
            )
        if self.dask and (not self.suite or self.video or self.jobs):
            raise ValueError("--dask: goes with --suite, and not with --video or --jobs")


def default_tracks() -> list[str]:
    """Return the named tracks in both directions, and a range of random tracks."""
    from pilot.simulator.catalogue import both_ways, track_names

    return [*both_ways(track_names()), "random:0-4"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate with the options in `arguments` (default: sys.argv), and return the exit code."""

    def check_and_evaluate() -> None:
        config = tyro.cli(EvaluationConfig, prog=PROGRAM, args=arguments)
        config.check()
        (measure if config.suite else evaluate)(config)

    return cli.run(PROGRAM, check_and_evaluate)


def evaluate(config: EvaluationConfig) -> None:
    """Evaluate all models on all scenarios; print the scores, and write them with the figures to `config.out`.

    Raises:
        ValueError, OSError, RuntimeError: the evaluation is not possible; the message says why and what to do.
    """
    # imported here, so that --help and invalid options do not wait for PyTorch
    from pilot.evaluation.table import table, verdict, write_json

    process_settings.for_driving()
    entrants = contestants(config.models)
    for each in entrants:
        each.check()  # an unusable model is refused before minutes of driving
    drivers = {each.name: each.driver for each in entrants}
    scenarios = [*track_scenarios(config), *recording_scenarios(config)]
    trajectories = drive_all(config, drivers, scenarios)
    evaluations = [
        report(config.out / name, name, {scenario: trajectories[name, scenario.title] for scenario in scenarios})
        for name in drivers
    ]
    write_json(config.out / "scores.json", evaluations, asdict(config))
    show("\n".join([table(evaluations), "", *map(verdict, evaluations)]))
    show(f"scores and figures: {config.out}{os.sep}")


def measure(config: EvaluationConfig) -> None:
    """Measure all models by a suite; print the results, and write them with the page to `config.out`.

    Raises:
        ValueError, OSError, RuntimeError: the evaluation is not possible; the message says why and what to do.
    """
    from pilot.board.measurement import results_in
    from pilot.board.page import rank, text_table, write_page
    from pilot.board.suite import SUITES

    process_settings.for_driving()
    suite = SUITES[str(config.suite)]
    try:
        measure_with(config, suite, contestants(config.models))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"what is measured is in {config.out}; the same command continues") from None
    results = list(results_in(config.out, suite))
    show(text_table(suite, rank(results)))
    show(f"page: {write_page(config.out, suite, results)}")


def measure_with(config: EvaluationConfig, suite: "Suite", drivers: "Sequence[Contestant]") -> None:
    """Measure models with the engine that was chosen.

    Raises:
        ClusterError: the cluster cannot be used.
        OSError, RuntimeError: as for `measure_all`.
    """
    from pilot.board.cluster import Cluster
    from pilot.board.measurement import in_processes, measure_all

    if config.dask is None:
        measure_all(suite, drivers, config.out, in_processes(config.jobs), clips=config.video)
        return
    with Cluster(config.dask) as cluster:
        measure_all(suite, drivers, config.out, cluster.run)


def track_scenarios(config: EvaluationConfig) -> "list[Scenario]":
    """Return a scenario for each track in each light.

    Raises:
        ValueError: there is no such track.
    """
    from pilot.evaluation.scenarios import TrackScenario
    from pilot.simulator.catalogue import load_track

    for track in config.driven_tracks:
        load_track(track)
    return [
        TrackScenario(track, light, config.seeds or (None,), config.conditions, config.socket)
        for track in config.driven_tracks
        for light in config.lights or (None,)
    ]


def recording_scenarios(config: EvaluationConfig) -> "list[Scenario]":
    """Return a scenario for each recording, after detecting the road in its images, which takes a while.

    Raises:
        NoUsableData, UnusableRecording: a recording cannot be replayed.
    """
    from tqdm import tqdm

    from pilot.evaluation.scenarios import prepare_scenario
    from pilot.workers import run_tasks

    folders = [folder.resolve() for folder in config.recordings]
    named = list(zip(name_paths(folders), folders, strict=True))
    found = run_tasks(partial(prepare_scenario, config.last_part), named, config.jobs, process_settings.for_driving)
    prepared = dict(
        tqdm(
            found,
            "finding the road",
            len(config.recordings),
            unit=" recordings",
            leave=False,
            disable=not config.recordings,
        )
    )
    return [prepared[number] for number in range(len(config.recordings))]


def name_paths(paths: Sequence[Path]) -> list[str]:
    """Return a distinct name for each model or recording: the stem of its path or, if not unique, the whole path.

    Raises:
        ValueError: a path is given twice.
    """
    stems = [path.stem for path in paths]
    names = [
        stem if stems.count(stem) == 1 else "-".join(path.with_suffix("").parts).strip(os.sep + "-")
        for stem, path in zip(stems, paths, strict=True)
    ]
    if len(set(names)) < len(names):
        raise ValueError("a model or a recording is given twice")
    return names


def contestants(models: Sequence[Path]) -> "list[Contestant]":
    """Return the drivers that are to be evaluated: models, and possibly the expert.

    Raises:
        ValueError: a path is given twice.
    """
    from pilot.board.measurement import Contestant

    return [
        Contestant(name, None if path == EXPERT else path)
        for name, path in zip(name_paths(models), models, strict=True)
    ]


def drive_all(
    config: EvaluationConfig,
    drivers: "dict[str, PolicyFactory]",
    scenarios: "Sequence[Scenario]",
) -> "dict[tuple[str, str], list[Trajectory]]":
    """Drive all models on all scenarios, in parallel, with a progress bar.

    Returns:
        The trajectories by name of the model and title of the scenario.
    """
    from tqdm import tqdm

    from pilot.workers import run_tasks

    processes = config.jobs or os.cpu_count() or 1
    tasks = [
        ((name, scenario.title), task)
        for scenario in scenarios
        for name, driver in drivers.items()
        for task in scenario.drive_tasks(driver, config.out / name if config.video else None, processes)
    ]
    done = dict(
        tqdm(
            run_tasks(operator.call, [task for _, task in tasks], config.jobs, process_settings.for_driving),
            "driving",
            len(tasks),
            unit=" tasks",
            leave=False,
        )
    )
    trajectories: dict[tuple[str, str], list[Trajectory]] = {key: [] for key, _ in tasks}
    for number, (key, _) in enumerate(tasks):
        trajectories[key] += done[number]
    return trajectories


def report(folder: Path, name: str, trajectory: "dict[Scenario, list[Trajectory]]") -> "Evaluation":
    """Compute a model's scores from the trajectories of each scenario, and draw a figure of each into `folder`."""
    from pilot.evaluation.table import Evaluation
    from pilot.simulator.scores import score
    from pilot.training.plots import save

    rows = {scenario: score(scenario.title, trajectories) for scenario, trajectories in trajectory.items()}
    for scenario, scores in rows.items():
        save(scenario.draw(f"{name}, {scenario.title}", trajectory[scenario], scores), folder / f"{scenario.file}.png")
    total = score("all", [trajectory for trajectories in trajectory.values() for trajectory in trajectories])
    return Evaluation(name, tuple(rows.values()), total)
