"""How well does a model drive? python evaluate.py model.pt (see --help)."""

import logging
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from pilot.evaluation.plan import Setup, expand_tracks

if TYPE_CHECKING:
    from pilot.evaluation.closed_loop import MakeSteer, Task
    from pilot.evaluation.scores import Driven
    from pilot.evaluation.table import Evaluation

EXPERT = Path("expert")  # as a model: the built-in simulator's expert
TRACKS = ("lake", "lake reversed", "jungle", "jungle reversed", "mountain", "mountain reversed", "random:0-4")


@dataclass(frozen=True)
class EvaluationConfig:
    """Have models drive in the built-in simulator, and tell how well they do.

    The car is put back whenever it leaves the road. Same options, same figures.
    """

    models: tyro.conf.Positional[tuple[Path, ...]]
    """The trained models, such as model.pt; `expert` is the driver who recorded the demonstrations."""
    tracks: tuple[str, ...] = TRACKS
    """lake, jungle, mountain, random:SEED, or a range such as random:0-49; "lake reversed" is the other way round."""
    lights: tuple[Literal["noon", "evening", "overcast"], ...] = ()
    """Each track in each of these; without it, in its own."""
    seeds: tuple[int, ...] = ()
    """Start places, one drive for each; without it, the start line."""
    setup: tyro.conf.OmitArgPrefixes[Setup] = field(default_factory=Setup)
    socket: bool = False
    """Through the real drive.py and its socket, instead of what is in it; latency is then the wire's."""
    jobs: int | None = None
    """Drives at the same time; without it, one for each core."""
    out: Path = Path("evaluation")
    """Folder for scores.json and the pictures."""
    video: bool = False
    """Also make a clip of each drive."""

    def check(self) -> None:
        """Refuse what cannot be driven.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        self.setup.check()
        if not self.models:
            raise ValueError("which model? Such as: python evaluate.py model.pt")
        if self.jobs is not None and self.jobs < 1:
            raise ValueError(f"--jobs {self.jobs}: must be at least 1")
        if min(self.seeds, default=0) < 0:
            raise ValueError(f"--seeds {min(self.seeds)}: must not be negative")
        if self.socket and (self.setup.latency_ms, self.setup.lost_frames) != (Setup.latency_ms, Setup.lost_frames):
            raise ValueError("--socket: --latency-ms and --lost-frames are for drives without it")
        if self.socket and EXPERT in self.models:
            raise ValueError("--socket: the expert drives only without it")


@dataclass(frozen=True)
class Road:
    """A row of the table: a track in a light."""

    track: str
    light: str | None

    @property
    def title(self) -> str:
        """As the table names it."""
        return self.track + (f", {self.light}" if self.light else "")

    @property
    def file(self) -> str:
        """As its pictures are called."""
        return self.title.replace(",", "").replace(":", "-").replace(" ", "-")


def main(arguments: Sequence[str]) -> int:
    """Evaluate as the options say; returns the exit code."""
    config = tyro.cli(EvaluationConfig, prog="evaluate.py", args=arguments)
    logging.basicConfig(level=logging.ERROR, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    try:
        config.check()
        evaluate(config)
    except KeyboardInterrupt:
        print("\nInterrupted.", file=sys.stderr)
        return 130
    except (ValueError, OSError, RuntimeError) as error:
        print(f"evaluate.py: {error}", file=sys.stderr)
        return 1
    return 0


def evaluate(config: EvaluationConfig) -> None:
    """Drive, measure, print, write.

    Raises:
        ValueError, OSError, RuntimeError: with the cure in the message.
    """
    # imported here: --help and wrong options need not wait for torch
    from pilot.evaluation.table import table, verdict, write_json

    roads, names = check_roads(config), name_models(config.models)
    drivers = {name: make_driver(path) for name, path in zip(names, config.models, strict=True)}
    tasks = {(name, road): make_tasks(config, driver, road, config.out / name)
             for road in roads for name, driver in drivers.items()}
    driven = drive_all(config, tasks)
    evaluations = [report(config.out / name, name, {road: driven[name, road] for road in roads}) for name in names]
    write_json(config.out / "scores.json", evaluations, asdict(config))
    print(table(evaluations), "", *map(verdict, evaluations), sep="\n")
    print(f"figures and pictures: {config.out}{os.sep}")


def check_roads(config: EvaluationConfig) -> list[Road]:
    """Where to drive.

    Raises:
        ValueError: there is no such track.
    """
    from pilot.simulator.catalogue import load_track

    tracks = expand_tracks(config.tracks)
    for track in tracks:
        load_track(track)
    if not tracks:
        raise ValueError("--tracks: where to? Such as: --tracks lake jungle random:0-4")
    return [Road(track, light) for track in tracks for light in config.lights or (None,)]


def name_models(paths: Sequence[Path]) -> list[str]:
    """A name for each model, which is that of its folder in the report too: as short as tells them apart."""
    stems = [path.stem for path in paths]
    names = [stem if stems.count(stem) == 1 else "-".join(path.with_suffix("").parts).strip(os.sep + "-")
             for stem, path in zip(stems, paths, strict=True)]
    if len(set(names)) < len(names):
        raise ValueError("a model is named twice")
    return names


def make_driver(path: Path) -> "MakeSteer":
    """Who drives by a model.

    Raises:
        UnusableModel: the file is missing, damaged, or no model of this program.
    """
    from pilot.checkpoint import load_model
    from pilot.evaluation.closed_loop import ModelDriver, expert_driver

    if path == EXPERT:
        return expert_driver
    load_model(path)  # a wrong one is refused before minutes of driving
    return ModelDriver(path)


def make_tasks(config: EvaluationConfig, driver: "MakeSteer", road: Road, folder: Path) -> "list[Task]":
    """The drives of a model on a road, one for each start place."""
    from pilot.evaluation.closed_loop import Task

    tasks = []
    for seed in config.seeds or (None,):
        clip = folder / f"{road.file}{'' if seed is None else f'-{seed}'}.mp4"
        tasks.append(Task(driver, road.track, config.setup, road.light, seed, clip if config.video else None))
    return tasks


def drive_all(config: EvaluationConfig, tasks: "dict[tuple[str, Road], list[Task]]",
              ) -> "dict[tuple[str, Road], list[Driven]]":
    """Do the drives of every model and road, several at the same time, with a bar."""
    from tqdm import tqdm

    from pilot.evaluation.closed_loop import run
    from pilot.evaluation.over_socket import run_over_socket
    from pilot.workers import run_jobs

    one = run_over_socket if config.socket else run
    every = [task for part in tasks.values() for task in part]
    done = dict(tqdm(run_jobs(one, every, config.jobs), "driving", len(every), unit=" drives", leave=False))
    numbers = iter(range(len(every)))
    return {key: [done[next(numbers)] for _ in part] for key, part in tasks.items()}


def report(folder: Path, name: str, driven: "dict[Road, list[Driven]]") -> "Evaluation":
    """Measure what a model drove, and draw it into a folder."""
    from pilot.evaluation.pictures import draw_drives
    from pilot.evaluation.scores import measure
    from pilot.evaluation.table import Evaluation
    from pilot.plots import save
    from pilot.simulator.catalogue import load_track

    rows = {road: measure(road.title, drives) for road, drives in driven.items()}
    for road, scores in rows.items():
        figure = draw_drives(f"{name}, {road.title}", load_track(road.track), driven[road], scores)
        save(figure, folder / f"{road.file}.png")
    total = measure("all", [drive for drives in driven.values() for drive in drives])
    return Evaluation(name, tuple(rows.values()), total)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
