"""The built-in simulator in process: reset, step, look; no Unity, no GPU, no display."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pilot.arrays import Frame
from pilot.simulator.catalogue import load_course, load_track
from pilot.simulator.course import LIGHTS
from pilot.simulator.episode import CarState, Episode
from pilot.simulator.rendering.renderer import Renderer
from pilot.simulator.rendering.scene import Scene
from pilot.simulator.track import REVERSED

TICKS = 2  # of 20 ms in a step: the real simulator sends some 25 frames a second


@dataclass(frozen=True)
class Observation:
    """What there is after a step.

    Attributes:
        frames: by camera (center, left, right), 160x320x3 uint8 RGB each.
        state: where the car is and what it does.
    """

    frames: dict[str, Frame]
    state: CarState


class Simulator:
    """A car on a road with cameras.

    Attributes:
        drive: the car on its road; None before the first reset.
    """

    def __init__(self, cameras: tuple[str, ...] = ("center",), ticks: int = TICKS) -> None:
        """Make it; nothing is drawn yet.

        Args:
            cameras: of center, left and right; each costs time.
            ticks: of 20 ms that a step lasts.
        """
        self.cameras, self.ticks = cameras, ticks
        self._shown: tuple[str, str | None] | None = None

    def reset(self, track: str = "lake", seed: int | None = None, light: str | None = None) -> Observation:
        """Put the car on a road, standing.

        Args:
            track: lake, jungle, mountain or random:SEED; with " reversed" behind, the other way round.
            seed: None starts at the start line; a number at a place of the road that it chooses.
            light: noon, evening or overcast; None is the track's own.

        Raises:
            ValueError: there is no such track or light.
        """
        name = track.removesuffix(REVERSED)
        road = load_track(track)
        if light is not None and light not in LIGHTS:
            raise ValueError(f"light {light!r}: there are {', '.join(LIGHTS)}")
        if self._shown != (name, light):
            self._show(Scene(load_course(name), light))
            self._shown = (name, light)
        start = 0.0 if seed is None else float(np.random.default_rng(seed).uniform(0, road.length))
        self.episode = Episode(road, start)
        return Observation(self.look(), self.episode.state)

    def _show(self, scene: Scene) -> None:
        self.close()
        self.renderer = Renderer(scene, self.cameras)

    def step(self, steering: float, throttle: float) -> Observation:
        """Drive a step by a command, each -1..1 (steering positive to the right, throttle below 0 brakes)."""
        for _ in range(self.ticks):
            self.episode.advance(steering, throttle)
        return Observation(self.look(), self.episode.state)

    def look(self) -> dict[str, Frame]:
        """What the cameras see now."""
        return self.renderer.render_episode(self.episode)

    def close(self) -> None:
        """Free the renderer."""
        if self._shown is not None:
            self.renderer.close()
            self._shown = None

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_error: Any) -> None:
        self.close()
