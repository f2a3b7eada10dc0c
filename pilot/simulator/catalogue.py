"""Lookup of tracks and courses by name: those of the folder tracks/, and random:SEED."""

import functools
import importlib
import pkgutil
from typing import Any

from pilot.simulator import tracks
from pilot.simulator.course import Course
from pilot.simulator.random_course import random_course
from pilot.simulator.track import REVERSED, Track


def track_names() -> list[str]:
    """Return the names of the tracks in the folder tracks/, ordered by their NUMBER."""
    numbers = {module.name: _module(module.name).NUMBER for module in pkgutil.iter_modules(tracks.__path__)}
    return sorted(numbers, key=lambda name: (numbers[name], name))


def both_ways(names: list[str]) -> list[str]:
    """Return each name, followed by the name of the same track in the opposite direction."""
    return [name + way for name in names for way in ("", REVERSED)]


@functools.lru_cache(32)
def load_course(name: str) -> Course:
    """Load a course by the name of its track, or generate random:SEED (SEED is an integer, at least 0).

    Raises:
        ValueError: there is no track of this name.
    """
    if name in track_names():
        course: Course = _module(name).course()
        return course
    kind, _, seed = name.partition(":")
    if kind == "random" and seed.isdecimal():
        return random_course(int(seed))
    raise ValueError(f"track {name!r}: there are {', '.join(track_names())} and random:SEED, such as random:7")


def load_track(name: str) -> Track:
    """Return the track of a course, in the opposite direction if its name ends with " reversed".

    Raises:
        ValueError: there is no track of this name.
    """
    track = load_course(name.removesuffix(REVERSED)).track
    return track.reversed() if name.endswith(REVERSED) else track


def file_name(track: str) -> str:
    """Convert a track's name, optionally with ", LIGHT", to a file or folder name such as random-7-reversed."""
    return track.replace(",", "").replace(":", "-").replace(" ", "-")


def _module(name: str) -> Any:
    return importlib.import_module(f"{tracks.__name__}.{name}")
