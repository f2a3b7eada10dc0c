"""Recording of the expert on tracks: track → recording."""

import functools
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pilot import process_settings
from pilot.data import folders
from pilot.data.log_format import LOG_NAME
from pilot.data.recording_writer import RecordingWriter
from pilot.files import unwritable
from pilot.simulator.camera_variation import STANDARD, draw_variation
from pilot.simulator.catalogue import both_ways, file_name, track_names
from pilot.simulator.demonstration import DemonstrationConfig, demonstrate
from pilot.simulator.simulator import Simulator
from pilot.simulator.track import REVERSED
from pilot.vehicle import CAMERAS
from pilot.workers import run_tasks

# No wandering, so that the steering depends only on what the image shows; recoveries show how to return to the lane.
# Many different rows in little time: the centre camera only, and so few rows per second that a recovery consists of
# the row at its start, because two rows of one recovery teach less than those of two recoveries.
NAMED_TRACKS = DemonstrationConfig(laps=4, recoveries=500, rate=0.4, line_spread=0.1, cameras="center")
# The longest track, with two lanes and the most bends.
JUNGLE = replace(NAMED_TRACKS, laps=6, recoveries=1200, line_spread=0.3)
RANDOM_TRACKS = replace(NAMED_TRACKS, laps=1, recoveries=130, line_spread=0.3, vary_cameras=True)
FIRST_RANDOM = 1000  # seed


@dataclass(frozen=True)
class DemonstrationSet:
    """Recordings of the expert that a training makes where there are none by a person.

    Attributes:
        folder: name of their subfolder of data/.
        tracks: what is demonstrated, by track.
    """

    folder: str
    tracks: Mapping[str, DemonstrationConfig]

    def missing(self, folder: Path) -> list[str]:
        """Return the tracks of which a folder has no recording yet."""
        return [track for track in self.tracks if not (folder / file_name(track) / LOG_NAME).exists()]


def _on_tracks(
    named: DemonstrationConfig, jungle: DemonstrationConfig, random: DemonstrationConfig, roads: int
) -> dict[str, DemonstrationConfig]:
    """Return what is demonstrated on the named tracks in both directions, and on random ones alternately."""
    return {
        **dict.fromkeys(both_ways(track_names()), named),
        **dict.fromkeys(both_ways(["jungle"]), jungle),
        **{f"random:{FIRST_RANDOM + road}" + REVERSED * (road % 2): random for road in range(roads)},
    }


BUILT_IN = DemonstrationSet(folders.BUILT_IN, _on_tracks(NAMED_TRACKS, JUNGLE, RANDOM_TRACKS, 130))
# Whole drives, for networks that see earlier frames or predict what comes later: rows 0.2 s apart, of which a recovery
# has about twelve. These are more rows, from fewer places.
_named = replace(NAMED_TRACKS, rate=5.0, laps=1, recoveries=150)
SEQUENCES = DemonstrationSet(
    folders.SEQUENCES,
    _on_tracks(
        _named,
        replace(_named, line_spread=JUNGLE.line_spread),
        replace(RANDOM_TRACKS, rate=5.0, recoveries=60),
        40,
    ),
)


def record(
    track: str,
    config: DemonstrationConfig,
    folder: Path,
    *,
    light: str | None = None,
    listed_as: Path | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
) -> int:
    """Record a demonstration by the expert on a track.

    Args:
        track: lake, jungle, mountain or random:SEED; with the suffix " reversed" in the opposite direction.
        config: what to demonstrate.
        folder: folder of the recording; rows are appended to an existing one.
        light: noon, clear, evening or overcast; None: the course's default.
        listed_as: folder for the paths in the log, if the recording will be moved there; None: `folder`.
        on_progress: called with the completed share (0..1) after each row.

    Returns:
        Number of rows written.

    Raises:
        ValueError: there is no such track or light, or a value of `config` is out of range.
        OSError: the folder cannot be written to.
    """
    config.check()
    with Simulator(CAMERAS if config.cameras == "all" else CAMERAS[:1]) as simulator:
        simulator.reset(track, light=light)
        with RecordingWriter(folder, listed_as) as writer:
            episode = simulator.episode
            random = np.random.default_rng([config.seed, 0xCA3E2A])
            for step in demonstrate(episode, config):
                variation = draw_variation(random) if config.vary_cameras else STANDARD
                frames, state = simulator.look(variation), episode.state
                writer.write(frames, state.time, step.command, state.speed, quality=variation.quality)
                on_progress(step.done)
            return writer.rows


def record_demonstrations(folder: Path, tracks: Sequence[tuple[str, DemonstrationConfig]]) -> Iterator[str]:
    """Record tracks into a folder in parallel, one worker process per core.

    Each recording is written atomically: an interrupted one is not left behind under its final name.

    Yields:
        The name of each track when its recording is complete.

    Raises:
        OSError: the folder cannot be written to.
        WorkerKilledError: a worker process was killed.
    """
    for number, _ in run_tasks(functools.partial(_record_whole, folder), tracks, None, process_settings.for_images):
        yield tracks[number][0]


def _record_whole(folder: Path, task: tuple[str, DemonstrationConfig]) -> None:
    track, config = task
    final, unfinished = folder / file_name(track), folder / f".{file_name(track)}.part"
    shutil.rmtree(unfinished, ignore_errors=True)
    record(track, config, unfinished, listed_as=final)
    shutil.rmtree(final, ignore_errors=True)  # exists only without a driving log, see `DemonstrationSet.missing`
    try:
        unfinished.rename(final)
    except OSError as error:
        raise unwritable(final, error) from error
