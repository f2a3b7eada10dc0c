"""The expert stays on every road, both ways round, and comes back to its lane."""

import math

import numpy as np
import pytest

from pilot.simulator.car import TICK
from pilot.simulator.catalogue import NAMED, load_course
from pilot.simulator.drive import Drive
from pilot.simulator.expert import Expert


def lap(name: str, *, backwards: bool, wander: float = 0.0, laps: int = 1) -> tuple[Drive, np.ndarray]:
    track = load_course(name).track
    drive = Drive(track.reversed() if backwards else track)
    expert = Expert(drive, 30.0, wander)
    offsets = []
    while drive.laps < laps:
        state = drive.advance(*expert.command())
        offsets.append(state.offset)
        assert state.on_road, state
        assert state.time < 200 * laps
    return drive, np.array(offsets)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", [*NAMED, "random:0", "random:1", "random:2"])
def test_drives_a_lap_in_its_lane(name: str, backwards: bool) -> None:
    drive, offsets = lap(name, backwards=backwards)
    assert np.abs(offsets).max() < 0.7
    assert drive.track.length / (drive.ticks * TICK) > 10  # m/s, where 13.4 is the car's most


def test_wanders_like_a_person_on_request() -> None:
    _, offsets = lap("mountain", backwards=False, wander=0.5)
    assert 0.2 < np.abs(offsets).mean() < 0.8


@pytest.mark.parametrize(("offset", "askew"), [(3.0, 0.0), (-3.0, 0.15), (0.0, -0.2)])
def test_comes_back_smoothly(offset: float, askew: float) -> None:
    drive = Drive(load_course("lake").track)
    drive.place(60.0, offset, askew, 25.0)
    expert = Expert(drive)
    steering = []
    for _ in range(round(5 / TICK)):
        steering.append(drive.advance(*expert.command()).steering)
    assert abs(drive.state.offset) < 0.2
    assert abs(drive.state.heading_error) < math.radians(1)
    assert np.abs(steering).max() < 0.6


def test_slows_down_for_hairpins() -> None:
    drive = Drive(load_course("jungle").track)
    tightest = int(np.abs(drive.track.curvatures).argmax()) * 0.5
    drive.place(tightest - 5.0, speed=30.0)
    assert Expert(drive, 30.0).command()[1] < 0  # brakes
