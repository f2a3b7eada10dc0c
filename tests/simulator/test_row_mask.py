"""Rendering of some rows only: they are the same to the bit as in the whole frame, also after JPEG."""

from collections.abc import Iterator

import numpy as np
import pytest

from pilot.arrays import Frame
from pilot.data.frames import decode_frame, encode_frame, encoded_with
from pilot.simulator.simulator import Simulator
from pilot.vehicle import CAMERAS, Rows

NETWORKS_ROWS = [(70, 135), (64, 140)]


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(("center", "left"))


def places(simulator: Simulator, count: int) -> Iterator[None]:
    """Put the car at places along the track, displaced and turned, one for each iteration."""
    for number in range(count):
        start = number / count * simulator.episode.track.length
        simulator.episode.place(start, (number % 5 - 2) * 0.7, (number % 7 - 3) * 0.15)
        yield


def through_jpeg(frame: Frame) -> Frame:
    return decode_frame(np.frombuffer(encode_frame(frame), np.uint8))


@pytest.mark.parametrize("track", ["lake", "jungle", "random:3"])
@pytest.mark.parametrize("rows", NETWORKS_ROWS)
def test_what_a_network_sees_is_the_same(simulator: Simulator, track: str, rows: Rows) -> None:
    simulator.reset(track)
    seen, rendered = slice(*rows), encoded_with(rows)
    for _ in places(simulator, 15):
        whole, part = simulator.look()["center"], simulator.look(rows=rendered)["center"]
        assert np.array_equal(whole[slice(*rendered)], part[slice(*rendered)])
        assert np.array_equal(through_jpeg(whole)[seen], through_jpeg(part)[seen])


def test_other_rows_are_black(simulator: Simulator) -> None:
    simulator.reset("lake")
    frame = simulator.look(rows=(64, 144))["center"]
    assert not frame[:64].any()
    assert not frame[144:].any()
    assert frame[64:144].any(axis=(1, 2)).all()


def test_each_camera_has_its_own_mask(simulator: Simulator) -> None:
    simulator.reset("jungle")
    whole, part = simulator.look(), simulator.look(rows=(64, 144))
    for camera in set(CAMERAS) & set(whole):
        assert np.array_equal(whole[camera][64:144], part[camera][64:144]), camera
    again = simulator.look()
    assert all(np.array_equal(whole[camera], again[camera]) for camera in whole)


@pytest.mark.parametrize("rows", [*NETWORKS_ROWS, (0, 160), (16, 17)])
def test_rows_that_jpeg_encodes_together(rows: Rows) -> None:
    random = np.random.default_rng(0)
    first, last = encoded_with(rows)
    frame = random.integers(0, 256, (160, 320, 3), np.uint8)
    part = np.zeros_like(frame)
    part[first:last] = frame[first:last]
    assert np.array_equal(through_jpeg(frame)[slice(*rows)], through_jpeg(part)[slice(*rows)])
    assert (first % 16, last % 16) == (0, 0)
