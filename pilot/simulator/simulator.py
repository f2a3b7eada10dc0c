"""Programming interface of the built-in simulator: reset, step, look."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pilot.arrays import Frame
from pilot.simulator.camera_variation import STANDARD, CameraVariation
from pilot.simulator.catalogue import load_course, load_track
from pilot.simulator.course import LIGHTS
from pilot.simulator.episode import CarState, Episode
from pilot.simulator.rendering.renderer import Renderer
from pilot.simulator.rendering.scene import Scene
from pilot.simulator.track import REVERSED
from pilot.vehicle import WHOLE_FRAME, Rows

TICKS = 2  # of 20 ms per step: the Unity simulator sends about 25 frames per second


@dataclass(frozen=True)
class Observation:
    """Result of a step.

    Attributes:
        frames: by camera name (center, left, right), 160x320x3 uint8 RGB each.
        state: of the car.
    """

    frames: dict[str, Frame]
    state: CarState


class Simulator:
    """Simulated car with cameras on a track.

    Attributes:
        cameras: names of the cameras that are rendered.
        ticks: duration of a step in ticks of 20 ms.
        episode: the car on its track; exists after the first `reset`.
        renderer: of the cameras; exists after the first `reset`, if there are cameras.
    """

    def __init__(self, cameras: tuple[str, ...] = ("center",), ticks: int = TICKS) -> None:
        """Create a simulator; `reset` must be called before `step` and `look`.

        Args:
            cameras: any of center, left and right; each takes time to render. Without one, no scene is built.
            ticks: duration of a step in ticks of 20 ms.
        """
        self.cameras, self.ticks = cameras, ticks
        self._shown: tuple[str, str | None] | None = None

    def reset(self, track: str = "lake", seed: int | None = None, light: str | None = None) -> Observation:
        """Start an episode with the car at rest in the middle of its lane.

        Args:
            track: lake, jungle, mountain or random:SEED; with the suffix " reversed" in the opposite direction.
            seed: of a random start position; None: the start line.
            light: noon, clear, evening or overcast; None: the course's default.

        Raises:
            ValueError: there is no such track or light.
        """
        name = track.removesuffix(REVERSED)
        road = load_track(track)
        if light is not None and light not in LIGHTS:
            raise ValueError(f"light {light!r}: there are {', '.join(LIGHTS)}")
        if self.cameras and self._shown != (name, light):
            self._show(Scene(load_course(name), light))
            self._shown = (name, light)
        start = 0.0 if seed is None else float(np.random.default_rng(seed).uniform(0, road.length))
        self.episode = Episode(road, start)
        return Observation(self.look(), self.episode.state)

    def _show(self, scene: Scene) -> None:
        self.close()
        self.renderer = Renderer(scene, self.cameras)

    def step(self, steering: float, throttle: float) -> Observation:
        """Apply a command (-1..1 each; right is positive, a negative throttle brakes) for the duration of a step."""
        for _ in range(self.ticks):
            self.episode.advance(steering, throttle)
        return Observation(self.look(), self.episode.state)

    def look(
        self, variation: CameraVariation = STANDARD, only: str | None = None, rows: Rows = WHOLE_FRAME
    ) -> dict[str, Frame]:
        """Render the current frames of all cameras or of `only` one, by camera name: 160x320x3 uint8 RGB each.

        All rows but `rows` are black, which takes less time.
        """
        return self.renderer.render_episode(self.episode, variation, only, rows) if self.cameras else {}

    def close(self) -> None:
        """Release the renderer's resources."""
        if self._shown is not None:
            self.renderer.close()
            self._shown = None

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_error: Any) -> None:
        self.close()
