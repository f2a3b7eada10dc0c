"""A window onto a drive: by hand, or by whoever else moves the car."""

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
PIPES = ("pandagl", "p3tinydisplay")  # OpenGL, or else Panda3D's software renderer
FRAME_SECONDS = TICK  # more pictures than ticks would only show the same again
DRIVING_KEYS, RECORDING_KEYS = "Arrows/WASD drive    Mouse held steers    ", "R record    "
KEYS = "Backspace back to road    C camera    H help    Esc quit"
BEHIND, ABOVE = 6.5, 2.4  # metres, chase camera from the rear axle
CLEARANCE = 1.0  # metres, that it keeps from the ground
SWING_SECONDS = 0.35  # in which it follows the car's turns
NO_DISPLAY = (
    "no window can be opened: there is no display. Without one there are `python simulator.py record` and "
    "`python simulator.py connect --headless`; `xvfb-run` makes a display that nobody sees"
)


class Control(Protocol):
    """Whoever moves the car."""

    def advance(self, seconds: float) -> None:
        """Move it by the time (s) that has passed since the last frame."""

    @property
    def done(self) -> bool:
        """Whether the drive is over."""


class Window:
    """Shows a drive, from the driver's place or from behind.

    Attributes:
        drive: what is shown.
        controls: keys, mouse and gamepad as they are held now.
        note: a message on the screen.
        behind: whether it is seen from behind.
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
            drive: the car on its road.
            scene: what there is to be seen of the road.
            capture: what R starts and stops; without it R does nothing.
            title: of the window.
            size: pixels, width and height; the user may change it.

        Raises:
            RuntimeError: there is no display.
        """
        self.episode, self.scene, self.capture = episode, scene, capture
        self.controls, self.note, self.behind = Controls(), "", False
        # an engine of its own: the one of the cameras draws whenever a picture is asked for
        self._engine = GraphicsEngine()
        self.output = _open(self._engine, title, size)
        self._inputs = Inputs(self.output, self.controls)
        self._hud = Hud(self.output)
        self._world = NodePath("world")
        scene.root.instance_to(self._world)  # so that the cameras, which look at the scene, do not see the car
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
        """Show the drive until its end, Escape or the window's closing; Ctrl-C raises KeyboardInterrupt."""
        self._hud.keys = (
            (DRIVING_KEYS if isinstance(control, ManualDriving) else "")
            + (RECORDING_KEYS if self.capture else "")
            + KEYS
        )
        then = time.monotonic()
        with catch_interrupt() as interrupt:
            while not (self._quit or interrupt.asked or control.done):
                time.sleep(max(then + FRAME_SECONDS - time.monotonic(), 0.0))
                then, before = time.monotonic(), then
                control.advance(then - before)
                self.draw(then - before)
                self.handle_keys()
            interrupt.raise_if_asked()

    def handle_keys(self) -> None:
        """Do what the keys pressed since the last call ask for."""
        actions = {
            "r": self._record,
            "backspace": self.episode.put_back,
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

    # The picture

    def draw(self, seconds: float) -> None:
        """Draw the drive as it stands, `seconds` after the last picture."""
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
        else:  # where the centre camera is, but level
            self._camera.set_pos_hpr(
                self._body.root, 0, CAMERA_AHEAD_OF_REAR_AXLE, CAMERA_HEIGHT, 0, -math.degrees(PITCH), 0
            )
        self.scene.sky.set_pos(self._camera.get_pos())

    def _place_behind(self) -> None:
        car, terrain = self.episode.car, self.scene.terrain
        x, y = car.x - BEHIND * math.sin(self._heading), car.y - BEHIND * math.cos(self._heading)
        ground = float(terrain.sample(terrain.heights, np.array([[x, y]]))[0])
        height = self._body.root.get_z()
        self._camera.set_pos(x, y, max(height + ABOVE, ground + CLEARANCE))
        east, north = 4.0 * math.sin(self._heading), 4.0 * math.cos(self._heading)
        self._camera.look_at(car.x + east, car.y + north, height + 0.8)

    def close(self) -> None:
        """Close the window for good."""
        self._engine.remove_all_windows()
        del self._inputs, self._hud, self.output  # a window of the software renderer must not outlive its pipe

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
    """Keep trifles off the terminal that Panda3D's modules and Xlib write there past all log levels on loading."""
    kept = os.dup(2)
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _open(engine: GraphicsEngine, title: str, size: tuple[int, int]) -> GraphicsWindow:
    """A window by the first renderer that can draw one."""
    properties = WindowProperties.size(*size)
    properties.set_title(title)
    buffers = FrameBufferProperties()
    buffers.set_rgb_color(True)
    buffers.set_depth_bits(24)
    buffers.set_back_buffers(1)  # without one nothing of OpenGL's picture need ever reach the screen
    for pipe in filter(None, map(_load_pipe, PIPES)):
        if pipe.is_valid():
            output = engine.make_output(pipe, title, 0, buffers, properties, GraphicsPipe.BF_require_window)
            engine.open_windows()
            if output and output.is_valid():
                return output
            engine.remove_all_windows()
    raise RuntimeError(NO_DISPLAY)


def drive_manually(track: str, light: str | None, out: Path) -> None:
    """Open a window and let the user drive; R records.

    Args:
        track: lake, jungle, mountain or random:SEED; with " reversed" behind, the other way round.
        light: noon, evening or overcast; None is the track's own.
        out: folder that R records into.

    Raises:
        ValueError: there is no such track or light.
        RuntimeError: there is no display.
    """
    with Simulator(CAMERAS) as simulator:
        simulator.reset(track, light=light)
        with (
            Capture(out, simulator.look) as capture,
            Window(simulator.episode, simulator.renderer.scene, capture, title=track) as window,
        ):
            window.run(ManualDriving(simulator.episode, window.controls, capture.add))
