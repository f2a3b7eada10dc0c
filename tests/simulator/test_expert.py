"""The expert stays on every road, both ways round, and comes back to its lane."""

import math

import numpy as np
import pytest

from pilot.simulator.catalogue import load_course, track_names
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.vehicle import TICK


def lap(name: str, *, backwards: bool, wander: float = 0.0, laps: int = 1) -> tuple[Episode, np.ndarray]:
    track = load_course(name).track
    episode = Episode(track.reversed() if backwards else track)
    expert = Expert(episode, 30.0, wander=wander)
    offsets = []
    while episode.laps < laps:
        state = episode.advance(*expert.command())
        offsets.append(state.cross_track_error)
        assert state.on_road, state
        assert state.time < 200 * laps
    return episode, np.array(offsets)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", [*track_names(), "random:0", "random:1", "random:2"])
def test_drives_a_lap_in_its_lane(name: str, backwards: bool) -> None:
    episode, offsets = lap(name, backwards=backwards)
    assert np.abs(offsets).max() < 1.4  # inside hairpins; a lane leaves 1.3 m to each side of the wheels
    assert np.abs(offsets).mean() < 0.4
    assert episode.track.length / (episode.ticks * TICK) > 7  # m/s, where 13.4 is the car's most


def test_wanders_like_a_person_on_request() -> None:
    _, offsets = lap("mountain", backwards=False, wander=0.5)
    assert 0.2 < np.abs(offsets).mean() < 0.8


@pytest.mark.parametrize(("offset", "askew"), [(3.0, 0.0), (-3.0, 0.15), (0.0, -0.2)])
def test_comes_back_smoothly(offset: float, askew: float) -> None:
    episode = Episode(load_course("lake").track)
    episode.place(60.0, offset, askew, 25.0)
    expert = Expert(episode)
    steering = []
    for _ in range(round(7 / TICK)):
        steering.append(episode.advance(*expert.command()).steering)
    assert abs(episode.state.cross_track_error) < 0.2
    assert abs(episode.state.heading_error) < math.radians(1)
    assert np.abs(steering).max() < 0.6


def test_slows_down_for_hairpins() -> None:
    episode = Episode(load_course("jungle").track)
    tightest = int(np.abs(episode.track.curvatures).argmax()) * 0.5
    episode.place(tightest - 5.0, speed=30.0)
    assert Expert(episode, 30.0).command()[1] < 0  # brakes
