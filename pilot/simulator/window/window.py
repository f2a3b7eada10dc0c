"""Window that shows a drive of the simulated car, with manual or any other control."""

import contextlib
import functools
import logging
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from panda3d.core import (
    Camera,
    FrameBufferProperties,
    GraphicsEngine,
    GraphicsPipe,
    GraphicsPipeSelection,
    GraphicsWindow,
    NodePath,
    PerspectiveLens,
    WindowProperties,
)

from pilot.interrupt import catch_interrupt
from pilot.simulator.episode import Episode
from pilot.simulator.rendering.body import Body
from pilot.simulator.rendering.renderer import FAR, NEAR
from pilot.simulator.rendering.scene import Scene
from pilot.simulator.simulator import Simulator
from pilot.simulator.window.capture import Capture
from pilot.simulator.window.controls import Controls, ManualDriving
from pilot.simulator.window.hud import Hud
from pilot.simulator.window.inputs import Inputs
from pilot.vehicle import CAMERA_AHEAD_OF_REAR_AXLE, CAMERA_HEIGHT, CAMERAS, FOCAL_LENGTH, MPH, PITCH, ROWS, TICK

log = logging.getLogger("pilot")

SIZE = (960, 540)  # pixels
PIPES = ("pandagl", "p3tinydisplay")  # OpenGL; if it is not available, Panda3D's software renderer
FRAME_SECONDS = TICK  # a higher frame rate would repeat images, because the car moves once per tick
RECORDING_KEYS = "R record    "
KEYS = "Backspace back to road    C camera    H help    Esc quit"
BEHIND, ABOVE = 6.5, 2.4  # metres, position of the chase camera relative to the rear axle
CLEARANCE = 1.0  # metres, minimum height of the camera above the ground
SWING_SECONDS = 0.35  # time constant with which the chase camera follows the car's heading
NO_DISPLAY = (
    "no window can be opened: there is no display. Without one there are `python simulator.py record` and "
    "`python simulator.py connect --headless`; `xvfb-run` makes a display that nobody sees"
)


class Control(Protocol):
    """Interface of an object that moves the car.

    Attributes:
        keys: text of the help: its keys and their functions.
        note: message to be displayed.
    """

    keys: str
    note: str

    def advance(self, seconds: float) -> None:
        """Move the car by the time in s since the last call."""

    @property
    def done(self) -> bool:
        """Whether the drive is over."""


class Window:
    """Shows an episode from the centre camera's position or from behind the car.

    Attributes:
        episode: that is shown.
        scene: of its course.
        capture: records the drive; None: no recording.
        controls: state of keys, mouse and gamepad.
        note: message to be displayed.
        behind: whether the chase camera, behind the car, is used.
        output: Panda3D's window.
    """

    def __init__(
        self,
        episode: Episode,
        scene: Scene,
        capture: Capture | None = None,
        *,
        title: str = "simulator",
        size: tuple[int, int] = SIZE,
    ) -> None:
        """Open the window.

        Args:
            episode: to be shown.
            scene: of the episode's course.
            capture: started and stopped by the key R; None: R has no effect.
            title: of the window.
            size: initial width and height in pixels; the user may change them.

        Raises:
            RuntimeError: there is no display.
        """
        self.episode, self.scene, self.capture = episode, scene, capture
        self.controls, self.note, self.behind = Controls(), "", False
        # a separate engine, because the cameras' engine renders whenever a frame is requested
        self._engine = GraphicsEngine()
        self.output = _open(self._engine, title, size)
        self._inputs = Inputs(self.output, self.controls)
        self._hud = Hud(self.output)
        self._world = NodePath("world")
        scene.root.instance_to(self._world)  # the cameras render scene.root, without the car
        self._body = Body(scene.light)
        self._body.root.reparent_to(self._world)
        self._lens = PerspectiveLens()
        self._camera = self._world.attach_new_node(Camera("window", self._lens))
        self._add_view()
        self._heading, self._travelled = episode.car.heading, 0.0
        self._quit = False

    def _add_view(self) -> None:
        self._lens.set_near_far(NEAR, FAR)
        self.output.set_clear_color((*(value / 255 for value in self.scene.light.sky), 1))
        self.output.make_display_region().set_camera(self._camera)
        self._aspect = 0.0

    # The loop

    def run(self, control: Control) -> None:
        """Show the drive until it is over, Escape is pressed or the window is closed.

        Args:
            control: moves the car.

        Raises:
            KeyboardInterrupt: on Ctrl-C or SIGTERM.
        """
        self._hud.keys = control.keys + (RECORDING_KEYS if self.capture else "") + KEYS
        then = time.monotonic()
        with catch_interrupt() as interrupt:
            while not (self._quit or interrupt.asked or control.done):
                time.sleep(max(then + FRAME_SECONDS - time.monotonic(), 0.0))
                then, before = time.monotonic(), then
                control.advance(then - before)
                self.note = control.note
                self.draw(then - before)
                self.handle_keys()
            interrupt.raise_if_asked()

    def handle_keys(self) -> None:
        """Perform the actions of the keys that were pressed since the last call."""
        actions = {
            "r": self._record,
            "backspace": self.episode.start_again,
            "c": self._change_camera,
            "h": self._toggle_help,
            "escape": self._end,
        }
        for key in self._inputs.poll():
            if key in actions:
                actions[key]()
        if self.output.is_closed():
            self._end()

    def _record(self) -> None:
        if self.capture:
            self.capture.toggle()

    def _change_camera(self) -> None:
        self.behind = not self.behind

    def _toggle_help(self) -> None:
        self._hud.help = not self._hud.help

    def _end(self) -> None:
        self._quit = True

    # Drawing

    def draw(self, seconds: float) -> None:
        """Draw the current state of the episode, given the time in s since the last call."""
        self._resize()
        self._place_car(seconds)
        self._place_camera(seconds)
        rows, message = (self.capture.rows, self.capture.message) if self.capture else (None, "")
        self._hud.show(self.episode.state, self.episode.laps, rows, message or self.note)
        self._engine.render_frame()

    def _resize(self) -> None:
        aspect = self.output.get_x_size() / max(self.output.get_y_size(), 1)
        if aspect != self._aspect:
            self._aspect = aspect
            self._lens.set_film_size(ROWS * aspect, ROWS)
            self._lens.set_focal_length(FOCAL_LENGTH)
            self._hud.resize(aspect)

    def _place_car(self, seconds: float) -> None:
        car, (steering, throttle) = self.episode.car, self.episode.command
        self._travelled += car.speed * seconds
        pitch = math.degrees(math.atan(self.episode.slope))
        self._body.root.set_pos_hpr(car.x, car.y, self.scene.ground(self.episode), -math.degrees(car.heading), pitch, 0)
        self._body.show(steering, self._travelled, braking=throttle < 0 and car.speed > -MPH)

    def _place_camera(self, seconds: float) -> None:
        car = self.episode.car
        turn = (car.heading - self._heading + math.pi) % (2 * math.pi) - math.pi
        self._heading += turn * (1 - math.exp(-seconds / SWING_SECONDS))
        if self.behind:
            self._place_behind()
        else:  # at the centre camera's position and pitch, but without its roll and yaw
            self._camera.set_pos_hpr(
                self._body.root, 0, CAMERA_AHEAD_OF_REAR_AXLE, CAMERA_HEIGHT, 0, -math.degrees(PITCH), 0
            )
            self._keep_above_ground()
        self.scene.sky.set_pos(self._camera.get_pos())

    def _keep_above_ground(self) -> None:
        """Raise the camera where it would be in the slope beside the road, or so near that it looks through it."""
        x, y, z = self._camera.get_pos()
        ahead = np.array([math.sin(self._heading), math.cos(self._heading)])
        points = np.array([x, y]) + np.outer(CLEARANCE * np.arange(4), ahead)
        ground = float(self.scene.terrain.sample(self.scene.terrain.heights, points).max())
        self._camera.set_z(max(z, ground + CLEARANCE))

    def _place_behind(self) -> None:
        car = self.episode.car
        x, y = car.x - BEHIND * math.sin(self._heading), car.y - BEHIND * math.cos(self._heading)
        height = self._body.root.get_z()
        self._camera.set_pos(x, y, height + ABOVE)
        self._keep_above_ground()
        east, north = 4.0 * math.sin(self._heading), 4.0 * math.cos(self._heading)
        self._camera.look_at(car.x + east, car.y + north, height + 0.8)

    def close(self) -> None:
        """Close the window; it cannot be used any more."""
        self._engine.remove_all_windows()
        del self._inputs, self._hud, self.output  # the software renderer's window must be freed before its pipe

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Any) -> None:
        self.close()


@functools.cache
def _load_pipe(name: str) -> GraphicsPipe | None:
    with _silence():
        return GraphicsPipeSelection.get_global_ptr().make_module_pipe(name)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Redirect stderr to the null device, because Panda3D's modules and Xlib ignore all log levels when loading."""
    kept = os.dup(2)
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _open(engine: GraphicsEngine, title: str, size: tuple[int, int]) -> GraphicsWindow:
    """Open a window with the first available renderer."""
    properties = WindowProperties.size(*size)
    properties.set_title(title)
    buffers = FrameBufferProperties()
    buffers.set_rgb_color(True)
    buffers.set_depth_bits(24)
    buffers.set_back_buffers(1)  # without one, OpenGL may never show what was drawn
    for pipe in filter(None, map(_load_pipe, PIPES)):
        if pipe.is_valid():
            output = engine.make_output(pipe, title, 0, buffers, properties, GraphicsPipe.BF_require_window)
            engine.open_windows()
            if output and output.is_valid():
                return output
            engine.remove_all_windows()
    raise RuntimeError(NO_DISPLAY)


def drive_manually(track: str, light: str | None, out: Path) -> None:
    """Open a window for manual driving; the key R starts and stops recording.

    Args:
        track: lake, jungle, mountain or random:SEED; followed by " reversed" for the opposite direction.
        light: noon, evening or overcast; None: the track's default.
        out: folder of the recording.

    Raises:
        ValueError: the track or light does not exist.
        RuntimeError: there is no display.
    """
    with Simulator(CAMERAS) as simulator:
        simulator.reset(track, light=light)
        with (
            Capture(out, simulator.look) as capture,
            Window(simulator.episode, simulator.renderer.scene, capture, title=track) as window,
        ):
            window.run(ManualDriving(simulator.episode, window.controls, capture.add, window.scene.is_lost))
