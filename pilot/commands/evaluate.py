"""How well does a model drive? python evaluate.py model.pt (see --help)."""

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

if TYPE_CHECKING:
    from pilot.evaluation.closed_loop import PolicyFactory
    from pilot.evaluation.scenarios import Scenario
    from pilot.evaluation.table import Evaluation
    from pilot.simulator.trajectory import Trajectory

PROGRAM = cli.program("evaluate.py")
EXPERT = Path("expert")  # as a model: the built-in simulator's expert


@dataclass(frozen=True)
class EvaluationConfig:
    """Have models drive in the built-in simulator, or replay recordings to them, and tell how well they do.

    The car is put back whenever it leaves the road. Same options, same figures.
    """

    models: tyro.conf.Positional[tuple[Path, ...]]
    """The trained models, such as model.pt; `expert` is the driver who recorded the demonstrations."""
    tracks: tuple[str, ...] = ()
    """lake, jungle, mountain, random:SEED, or a range such as random:0-49; "lake reversed" is the other way round.
    Without it, and without --recordings: these three both ways round, and random:0-4."""
    lights: tuple[Literal["noon", "evening", "overcast"], ...] = ()
    """Each track in each of these; without it, in its own."""
    seeds: tuple[int, ...] = ()
    """Start places, one drive for each; without it, the start line."""
    conditions: tyro.conf.OmitArgPrefixes[Conditions] = field(default_factory=Conditions)
    recordings: tuple[Path, ...] = ()
    """Recordings of people's drives to replay: the pictures are warped to where the model's car stands."""
    last_part: float = 1.0
    """Replay only this last share of each recording; to learn from the rest: model.py --samples.first-part."""
    socket: bool = False
    """Through the real drive.py and its socket, instead of what is in it; latency is then the wire's."""
    jobs: int | None = None
    """Drives at the same time; without it, one for each core."""
    out: Path = Path("evaluation")
    """Folder for scores.json and the pictures."""
    video: bool = False
    """Also make a clip of each drive."""

    @property
    def driven_tracks(self) -> list[str]:
        """The tracks, one by one.

        Raises:
            ValueError: a range is empty or absurd.
        """
        return expand_tracks(self.tracks or ([] if self.recordings else default_tracks()))

    def check(self) -> None:
        """Refuse what cannot be driven.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        self.conditions.check()
        if not self.models:
            raise ValueError("which model? Such as: python evaluate.py model.pt")
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
        if not 0 < self.last_part <= 1:
            raise ValueError(f"--last-part {self.last_part:g}: must be greater than 0, and at most 1")


def default_tracks() -> list[str]:
    """All tracks with names both ways round, and some random ones."""
    from pilot.simulator.catalogue import both_ways, track_names

    return [*both_ways(track_names()), "random:0-4"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate as the options (by default the command line's) say; returns the exit code."""
    config = tyro.cli(EvaluationConfig, prog=PROGRAM, args=arguments)

    def check_and_evaluate() -> None:
        config.check()
        evaluate(config)

    return cli.run(PROGRAM, check_and_evaluate)


def evaluate(config: EvaluationConfig) -> None:
    """Drive, measure, print, write.

    Raises:
        ValueError, OSError, RuntimeError: with the cure in the message.
    """
    # imported here: --help and wrong options need not wait for torch
    from pilot.evaluation.table import table, verdict, write_json

    process_settings.for_driving()
    names = name_paths(config.models)
    drivers = {name: make_driver(path) for name, path in zip(names, config.models, strict=True)}
    scenarios = [*track_scenarios(config), *recording_scenarios(config)]
    trajectories = drive_all(config, drivers, scenarios)
    evaluations = [
        report(config.out / name, name, {scenario: trajectories[name, scenario.title] for scenario in scenarios})
        for name in names
    ]
    write_json(config.out / "scores.json", evaluations, asdict(config))
    print(table(evaluations), "", *map(verdict, evaluations), sep="\n")
    print(f"figures and pictures: {config.out}{os.sep}")


def track_scenarios(config: EvaluationConfig) -> "list[Scenario]":
    """Where to drive.

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
    """What to replay: the road is found in each first, which takes a while.

    Raises:
        NoUsableData, UnusableRecording: it cannot be replayed.
    """
    from tqdm import tqdm

    from pilot.evaluation.scenarios import prepare_scenario
    from pilot.workers import run_tasks

    folders = [folder.resolve() for folder in config.recordings]
    named = list(zip(name_paths(folders), folders, strict=True))
    found = run_tasks(partial(prepare_scenario, config.last_part), named, config.jobs, process_settings.for_images)
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
    """A name for each model or recording, which its pictures have too: as short as tells them apart.

    Raises:
        ValueError: one of them is named twice.
    """
    stems = [path.stem for path in paths]
    names = [
        stem if stems.count(stem) == 1 else "-".join(path.with_suffix("").parts).strip(os.sep + "-")
        for stem, path in zip(stems, paths, strict=True)
    ]
    if len(set(names)) < len(names):
        raise ValueError("a model or a recording is named twice")
    return names


def make_driver(path: Path) -> "PolicyFactory":
    """Who drives by a model.

    Raises:
        UnusableModel: the file is missing, damaged, or no model of this program.
    """
    from pilot.evaluation.closed_loop import ModelPolicy, expert_policy
    from pilot.model.checkpoint import load_model

    if path == EXPERT:
        return expert_policy
    load_model(path)  # a wrong one is refused before minutes of driving
    return ModelPolicy(path)


def drive_all(
    config: EvaluationConfig,
    drivers: "dict[str, PolicyFactory]",
    scenarios: "Sequence[Scenario]",
) -> "dict[tuple[str, str], list[Trajectory]]":
    """Do the drives of every model and trial, several at the same time, with a bar; by model and title."""
    from tqdm import tqdm

    from pilot.workers import run_tasks

    tasks = [
        ((name, scenario.title), task)
        for scenario in scenarios
        for name, driver in drivers.items()
        for task in scenario.drive_tasks(driver, config.out / name if config.video else None)
    ]
    done = dict(
        tqdm(
            run_tasks(operator.call, [task for _, task in tasks], config.jobs, process_settings.for_driving),
            "driving",
            len(tasks),
            unit=" drives",
            leave=False,
        )
    )
    trajectories: dict[tuple[str, str], list[Trajectory]] = {key: [] for key, _ in tasks}
    for number, (key, _) in enumerate(tasks):
        trajectories[key] += done[number]
    return trajectories


def report(folder: Path, name: str, trajectory: "dict[Scenario, list[Trajectory]]") -> "Evaluation":
    """Measure what a model drove, and draw it into a folder."""
    from pilot.evaluation.table import Evaluation
    from pilot.simulator.scores import score
    from pilot.training.plots import save

    rows = {scenario: score(scenario.title, trajectories) for scenario, trajectories in trajectory.items()}
    for scenario, scores in rows.items():
        save(scenario.draw(f"{name}, {scenario.title}", trajectory[scenario], scores), folder / f"{scenario.file}.png")
    total = score("all", [trajectory for trajectories in trajectory.values() for trajectory in trajectories])
    return Evaluation(name, tuple(rows.values()), total)
