"""The tracks by name: those of the folder tracks/, and random:SEED, any number of them."""

import functools
import importlib
import pkgutil
from typing import Any

from pilot.simulator import tracks
from pilot.simulator.course import Course
from pilot.simulator.random_course import random_course
from pilot.simulator.track import REVERSED, Track


def track_names() -> list[str]:
    """The tracks that have a name of their own, in the order of their numbers."""
    numbers = {module.name: _module(module.name).NUMBER for module in pkgutil.iter_modules(tracks.__path__)}
    return sorted(numbers, key=lambda name: (numbers[name], name))


def both_ways(names: list[str]) -> list[str]:
    """Each track, and each driven the other way round."""
    return [name + way for name in names for way in ("", REVERSED)]


@functools.lru_cache(32)
def load_course(name: str) -> Course:
    """A course by the name of its track, or random:SEED (SEED a whole number from 0).

    Raises:
        ValueError: there is none of that name.
    """
    if name in track_names():
        course: Course = _module(name).course()
        return course
    kind, _, seed = name.partition(":")
    if kind == "random" and seed.isdecimal():
        return random_course(int(seed))
    raise ValueError(f"track {name!r}: there are {', '.join(track_names())} and random:SEED, such as random:7")


def load_track(name: str) -> Track:
    """The road of a course, in the direction of driving: with " reversed" behind its name, the other way round.

    Raises:
        ValueError: there is none of that name.
    """
    track = load_course(name.removesuffix(REVERSED)).track
    return track.reversed() if name.endswith(REVERSED) else track


def file_name(track: str) -> str:
    """A track's name, maybe with its light behind a comma, as files and folders are called: random-7-reversed."""
    return track.replace(",", "").replace(":", "-").replace(" ", "-")


def _module(name: str) -> Any:
    return importlib.import_module(f"{tracks.__name__}.{name}")
