"""Map matching: the track, the direction and the place of a recording, from its steering and speed alone."""

import numpy as np
import pandas as pd
import pytest

from pilot.data.motion import Motion, motion_of
from pilot.evaluation.map_matching import match_track
from pilot.simulator.catalogue import both_ways, load_track
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.simulator.track import Track

TRACKS = [load_track(name) for name in both_ways(["lake", "jungle"])]
EVERY = 5  # ticks per row: 10 Hz


def driven(track: Track, start: float, seconds: float, scale: float = 1.0) -> tuple[Motion, np.ndarray]:
    """Motion of the expert with noisy steering, and its true progress per row; `scale` falsifies the speed."""
    episode, random = Episode(track, start), np.random.default_rng(0)
    expert, rows, progress = Expert(episode), [], []
    while episode.ticks < 50 * seconds:
        state = episode.advance(*expert.command())
        if episode.ticks % EVERY == 0:
            rows.append((state.time, state.steering + random.normal(0, 0.05), state.speed / scale))
            progress.append(episode.where.progress)
    return motion_of(pd.DataFrame(rows, columns=["time", "steering", "speed"])), np.array(progress)


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize("scale", [1.0, 1.04])
def test_finds_track_direction_and_place(index: int, scale: float) -> None:
    track = TRACKS[index]
    motion, progress = driven(track, 0.7 * track.length, 60.0, scale)
    match = match_track(motion, TRACKS)
    assert match.track.name == track.name
    assert match.correlation > 0.8
    assert match.scale == pytest.approx(scale, abs=0.021)
    errors = (match.progress - progress + track.length / 2) % track.length - track.length / 2
    assert np.abs(errors).mean() < 3.0
    assert np.abs(errors).max() < 10.0


def test_another_road_fits_worse() -> None:
    motion, _ = driven(load_track("mountain"), 0.0, 60.0)
    assert match_track(motion, TRACKS).correlation < 0.75
