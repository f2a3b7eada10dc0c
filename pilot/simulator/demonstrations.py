"""Have the expert drive a course and record it: course → recording."""

import functools
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from pilot import process_settings
from pilot.data.log_format import LOG_NAME
from pilot.data.recording_writer import RecordingWriter
from pilot.simulator.catalogue import both_ways, file_name, track_names
from pilot.simulator.demonstration import DemonstrationConfig, demonstrate
from pilot.simulator.simulator import Simulator
from pilot.simulator.track import REVERSED
from pilot.vehicle import CAMERAS
from pilot.workers import run_tasks

# The demonstration that stands in for a person's laps: a bit of everything, both ways round.
# Without wandering: a row's label is then what the picture asks for, and the recoveries show the way back.
NAMED_TRACKS = DemonstrationConfig(laps=1, recoveries=40, rate=2.0)
RANDOM_TRACKS = DemonstrationConfig(laps=1, recoveries=14, rate=0.4)  # few rows of many roads
DEMONSTRATIONS: dict[str, DemonstrationConfig] = {
    **dict.fromkeys(both_ways(track_names()), NAMED_TRACKS),
    **{f"random:{seed}" + REVERSED * (seed % 2): RANDOM_TRACKS for seed in range(1000, 1150)},
}


def record(
    track: str,
    config: DemonstrationConfig,
    folder: Path,
    *,
    light: str | None = None,
    listed_as: Path | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
) -> int:
    """Record the expert on a track (lake, jungle, mountain, random:SEED, with " reversed" behind for the other way).

    Returns:
        rows written.

    Raises:
        ValueError: there is no such track or light, or the config makes no sense.
        OSError: the folder cannot be written to.
    """
    config.check()
    with Simulator(CAMERAS) as simulator:
        simulator.reset(track, light=light)
        with RecordingWriter(folder, listed_as) as writer:
            episode = simulator.episode
            for step in demonstrate(episode, config):
                writer.write(simulator.look(), episode.state.time, step.command, episode.state.speed)
                on_progress(step.done)
            return writer.rows


def missing_demonstrations(folder: Path) -> list[str]:
    """The tracks of the demonstration that are not in a folder yet."""
    return [track for track in DEMONSTRATIONS if not (folder / file_name(track) / LOG_NAME).exists()]


def record_demonstrations(folder: Path, tracks: Sequence[str]) -> Iterator[str]:
    """Record tracks of the demonstration into a folder, as many at once as there are cores; yields those done.

    Each is there as a whole or not at all, whatever interrupts it.

    Raises:
        OSError: the folder cannot be written to.
    """
    for number, _ in run_tasks(functools.partial(_record_whole, folder), tracks, None, process_settings.for_images):
        yield tracks[number]


def _record_whole(folder: Path, track: str) -> None:
    final, unfinished = folder / file_name(track), folder / f".{file_name(track)}.part"
    shutil.rmtree(unfinished, ignore_errors=True)
    record(track, DEMONSTRATIONS[track], unfinished, listed_as=final)
    shutil.rmtree(final, ignore_errors=True)  # without a log: of no use
    unfinished.rename(final)
