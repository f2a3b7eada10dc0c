"""Gymnasium environment: one car on a track of the built-in simulator."""

from collections import deque
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Frame
from pilot.driving.controller import ControllerConfig, SpeedController
from pilot.environments.observations import State, observation_space, state_vector
from pilot.environments.options import RANDOM, TICK_MS, driving_options
from pilot.environments.rewards import reward
from pilot.simulator.catalogue import load_track, track_names
from pilot.simulator.episode import CarState
from pilot.simulator.referee import AT_ONCE, MIN_PROGRESS, time_limit
from pilot.simulator.simulator import TICKS, Simulator
from pilot.simulator.track import REVERSED
from pilot.vehicle import TICK

STEP_SECONDS = TICKS * TICK
CAMERA = "center"
Command = tuple[float, float]
Action = NDArray[np.float32]


class DrivingEnv(gymnasium.Env[Frame | State, Action]):
    """A car to be driven along a road; a step takes 40 ms, the rate of the Unity simulator's frames.

    Deterministic: the same options, seed and actions give the same bytes, in any process.

    Attributes:
        options: as given to `gymnasium.make`.
        simulator: the built-in simulator; its `episode` is the car on its track.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(1 / STEP_SECONDS)}  # noqa: RUF012

    def __init__(self, track: str, render_mode: str | None = None, **options: Any) -> None:
        """Create the environment; scenes are built by `reset`, and only if there is something to render.

        Args:
            track: a named track, random:SEED, or random: another road in every episode.
            render_mode: rgb_array: `render` returns the centre camera's frame; None: it is not needed.
            options: values of `DrivingOptions`.

        Raises:
            ValueError: there is no such track, render mode or option, or a value is invalid.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode={render_mode!r}: must be rgb_array, or None")
        self.options, self.render_mode = driving_options(options), render_mode
        self._check_track(track)
        self.track = track
        self.observation_space: gymnasium.Space[Any] = observation_space(self.options.observations)
        self._axes = 1 if self.options.actions == "steering" else 2
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (self._axes,), np.float32)
        rendered = self.options.observations == "image" or render_mode is not None
        self.simulator = Simulator((CAMERA,) if rendered else ())
        self._controller = SpeedController(ControllerConfig(speed=self.options.speed))

    @staticmethod
    def _check_track(track: str) -> None:
        if track != RANDOM:
            try:
                load_track(track)
            except ValueError as error:
                raise ValueError(f"track={track!r}: must be one of {', '.join(track_names())}, random") from error

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Frame | State, dict[str, Any]]:
        """Start an episode with the car at rest in the middle of its lane.

        Args:
            seed: of all that is drawn at random: the road of Random-v0 and random starts.
            options: none; they are given to `gymnasium.make`.

        Returns:
            the observation, and the figures described in docs/environments.md.
        """
        super().reset(seed=seed)
        start = int(self.np_random.integers(2**31)) if self.options.random_start else None
        self.simulator.reset(self._next_track(), start, self.options.light)
        self._controller.reset()
        self._commands: deque[Command] = deque([(0.0, 0.0)] * (self.options.latency_ms // TICK_MS))
        self._state = self._moved = self.simulator.episode.state
        track = self.simulator.episode.track
        self._seconds = self.options.seconds or time_limit(track, self.options.laps, self.options.speed)
        return self._observation(), self._info()

    def _next_track(self) -> str:
        first, last = self.options.roads
        name = f"random:{self.np_random.integers(first, last + 1)}" if self.track == RANDOM else self.track
        return name + REVERSED if self.options.reversed else name

    def step(self, action: Action) -> tuple[Frame | State, float, bool, bool, dict[str, Any]]:
        """Drive for 40 ms.

        Args:
            action: steering (-1..1, right is positive), and throttle (-1..1, negative brakes) if it is the agent's.

        Returns:
            observation, reward, terminated (left the road, stood for 10 s, or completed the laps), truncated (out of
            time), and the figures described in docs/environments.md.

        Raises:
            ValueError: the action has another shape, or is not finite.
        """
        command, before = self._command(action), self._state
        for _ in range(TICKS):
            self._commands.append(command)
            self._state = self.simulator.episode.advance(*self._commands.popleft())
        if self._state.progress >= self._moved.progress + MIN_PROGRESS:
            self._moved = self._state
        info = self._info()
        terminated = info["off_road"] or info["standing"] or info["completed"]
        truncated = not terminated and self._state.time >= self._seconds - TICK / 2
        return self._observation(), reward(before, self._state), terminated, truncated, info

    def _command(self, action: Action) -> Command:
        """Return steering and throttle; the latter from the controller unless it is the agent's."""
        values = np.asarray(action, float)
        if values.shape != (self._axes,) or not np.isfinite(values).all():
            raise ValueError(f"action {action!r}: must be an array of {self._axes} finite numbers in -1..1")
        steering, *throttle = values.clip(-1.0, 1.0).tolist()
        if throttle:
            return steering, throttle[0]
        return steering, self._controller.throttle(self._state.speed, steering, STEP_SECONDS)

    def _observation(self) -> Frame | State:
        if self.options.observations == "image":
            return self.simulator.look()[CAMERA]
        return state_vector(self.simulator.episode, self._state)

    def _info(self) -> dict[str, Any]:
        state: CarState = self._state
        return {
            "track": self.simulator.episode.track.name,
            "time": state.time,
            "speed": state.speed,
            "steering": state.steering,
            "throttle": state.throttle,
            "cross_track_error": state.cross_track_error,
            "heading_error": state.heading_error,
            "progress": state.progress,
            "laps": self.simulator.episode.laps,
            "completed": self.simulator.episode.laps >= self.options.laps,
            "off_road": not state.on_road,
            "standing": state.time - self._moved.time >= AT_ONCE.standing_seconds,
        }

    def render(self) -> Frame | None:
        """Return the centre camera's frame (160x320x3 uint8 RGB), or None without a render mode."""
        return self.simulator.look()[CAMERA] if self.render_mode else None

    def close(self) -> None:
        """Release the renderer."""
        self.simulator.close()
