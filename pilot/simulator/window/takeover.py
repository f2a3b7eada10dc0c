"""Taking over from a model in the window, while the steering keys, the mouse or the gamepad's stick are held."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pilot.arrays import Frame
from pilot.data.recording_writer import RECORDING_RATE, RecordingWriter, is_due
from pilot.data.steered_by import Steerer
from pilot.driving.controller import ControllerConfig, SpeedController
from pilot.driving.correction_buffer import CorrectionBuffer
from pilot.simulator.episode import CarState
from pilot.simulator.window.capture import log
from pilot.simulator.window.controls import Controls
from pilot.simulator.wire.client import Client, Command
from pilot.vehicle import TICK, TOP_SPEED_MPH


class Takeover:
    """Lets a server drive the car of a window, and a person while he steers.

    Attributes:
        keys: text of the help.
        note: message to be displayed.
    """

    keys = "Arrows/AD or mouse held: steer instead of the model    "

    def __init__(self, client: Client, controls: Controls) -> None:
        """Connect a client, whose car a server drives, with the controls of a window."""
        self.client, self.controls, self.note = client, controls, ""
        self._speed = SpeedController(ControllerConfig())

    def advance(self, seconds: float) -> None:
        """Move the car by the time in s since the last call."""
        if not self.controls.steers:
            self.client.manual = None
        elif self.client.manual is None:
            self._take_over()
        self.note = "you steer; let go, and the model drives on" if self.client.manual else ""
        self.client.advance(seconds)

    def _take_over(self) -> None:
        state = self.client.episode.state
        self.controls.steering = state.steering
        self._speed = SpeedController(ControllerConfig(speed=min(max(state.speed, 0.0), TOP_SPEED_MPH), lateral_g=0))
        self.client.manual = self._command

    def _command(self) -> Command:
        """Return the person's command for the next tick; without a pedal, the speed is kept."""
        steering, throttle = self.controls.tick()
        if not self.controls.pedals:
            throttle = self._speed.throttle(abs(self.client.episode.state.speed), steering, TICK)
        return steering, throttle

    @property
    def done(self) -> bool:
        """Whether the drive is over."""
        return self.client.done


@dataclass(frozen=True)
class _Row:
    frames: dict[str, Frame]
    seconds: float
    command: Command
    speed: float
    steerer: Steerer


class CorrectionCapture:
    """Records what a person steers in place of the model, and the seconds before, with all three cameras.

    Attributes:
        folder: of this drive's corrections; None before the first one.
        rows: recorded, after `close`.
    """

    def __init__(self, parent: Path, look: Callable[[], dict[str, Frame]]) -> None:
        """Create a capture; nothing is written before the first correction.

        Args:
            parent: folder in which the folder of this drive is created.
            look: returns the current frames (160x320x3, uint8 RGB) by camera: left, center, right.
        """
        self.parent, self.rows = parent, 0
        self.folder: Path | None = None
        self._look = look
        self._buffer: CorrectionBuffer[_Row] = CorrectionBuffer()
        self._writer: RecordingWriter | None = None

    def add(self, state: CarState, steerer: Steerer) -> None:
        """Record the state after a tick, if a row is due."""
        if not is_due(round(state.time / TICK), RECORDING_RATE):
            return
        command = (state.steering, state.throttle)
        row = _Row(self._look(), state.time, command, max(state.speed, 0.0), steerer)
        if due := self._buffer.add(row, state.time, steerer):
            self._write(due)

    def _write(self, rows: list[_Row]) -> None:
        """Write rows; a full disk ends the recording, not the drive."""
        try:
            if self.folder is None:
                self.folder = self.parent / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
                self._writer = RecordingWriter(self.folder)
            if self._writer:
                for row in rows:
                    self._writer.write(row.frames, row.seconds, row.command, row.speed, steerer=row.steerer)
        except OSError as error:
            log.error("the corrections are not recorded any more: %s. The car drives on", error)
            self.close()

    @property
    def number(self) -> int:
        """Number of corrections so far."""
        return self._buffer.number

    def close(self) -> None:
        """End the recording."""
        writer, self._writer = self._writer, None
        if writer:
            self.rows = writer.rows
            writer.close()
