"""Server that drives the simulator's car: python drive.py model.pt [run1] (see --help)."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from pilot import cli, process_settings
from pilot.driving.controller import ControllerConfig

if TYPE_CHECKING:
    from pilot.driving.drive_session import DriveSession

PROGRAM = cli.program("drive.py")


@dataclass(frozen=True)
class ServeConfig:
    """Drive the simulator's car in autonomous mode: steer with a trained model, and control the speed."""

    model: tyro.conf.Positional[Path]
    """Model file, such as model.pt, or an ONNX file."""
    run: tyro.conf.Positional[Path | None] = None
    """Folder in which to record the drive: frames and driving_log.csv."""
    overwrite: bool = False
    """Overwrite an existing recording in the folder."""
    corrections: Path | None = Path("data/corrections")
    """Folder for recordings of what you steer in place of the model, on the page or in the window; None: they are not
    recorded."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = 4567
    """Port to listen on; the simulator connects to 4567."""
    frame_seconds: float | None = None
    """For a simulator that does not run in real time: simulated seconds between two telemetry messages; 0.04 for
    simulator.py connect --fast. Default: real time."""
    drive: tyro.conf.OmitArgPrefixes[ControllerConfig] = field(default_factory=ControllerConfig)

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        self.drive.check()
        cli.check_address(self.host, self.port)
        if self.frame_seconds is not None and not 0 < self.frame_seconds <= 1:
            raise ValueError(f"--frame-seconds {self.frame_seconds:g}: must be greater than 0, and at most 1")


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until Ctrl-C, with the options in `arguments` (default: sys.argv), and return the exit code."""

    def drive() -> None:
        config = tyro.cli(ServeConfig, prog=PROGRAM, args=arguments)
        config.check()
        serve(config)

    return cli.run(PROGRAM, drive, verbose=True)


def serve(config: ServeConfig) -> None:
    """Load the model and serve the simulator until Ctrl-C.

    Raises:
        UnusableModel: the model file is missing, damaged, or not a model of this program.
        WrongVersionError: the installed packages do not support the simulator's protocol.
        FolderInUseError: `config.run` is a file, or contains a recording and `config.overwrite` is not set.
        OSError: the port is in use, or the folder of the recording cannot be created.
    """
    process_settings.for_serving()
    # imported here, so that --help and invalid options do not wait for PyTorch
    from pilot.driving.autopilot import Autopilot, FrameClock
    from pilot.driving.connections import listen
    from pilot.driving.corrections import Corrections
    from pilot.driving.dashboard.page import create_page
    from pilot.driving.dashboard.state import DriveState
    from pilot.driving.drive_session import DriveSession
    from pilot.driving.driver import Driver
    from pilot.driving.server import DriveServer, check_versions

    check_versions()
    process_settings.for_driving()
    driver = Driver.load(config.model)
    listener = listen(config.host, config.port)
    clock = FrameClock(config.frame_seconds) if config.frame_seconds else None
    autopilot = Autopilot(driver, config.drive, clock or time.perf_counter)
    corrections = Corrections(config.corrections) if config.corrections else None
    session = DriveSession(autopilot, config.model, driver, corrections=corrections)
    if config.run:
        session.record_into(config.run, overwrite=config.overwrite)
    state = DriveState(autopilot)
    observers = [state.observe, session.observe, *([clock.tick] if clock else [])]
    server, page = DriveServer(autopilot, observers), create_page(state, session)
    process_settings.after_loading()
    print(
        f"{config.model} ({driver.model.name}) is ready at {config.drive.speed:g} mph. Start the simulator in "
        f"autonomous mode; watch, and take the wheel, at http://{config.host}:{config.port}/ (Ctrl-C ends)",
        flush=True,
    )
    try:
        server.serve(listener, page, config.host)
    finally:
        session.close()
        if lines := report(session):
            print("\n" + "\n".join(lines))


def report(session: "DriveSession") -> list[str]:
    """Return lines about what was recorded, and what can be done with it."""
    from pilot.portable.onnx_model import SUFFIX  # slow to import

    lines = [
        f"{recorder.frames} frames in {recorder.folder}. For a clip: python video.py {recorder.folder}"
        for recorder in session.recordings
    ]
    corrections = session.corrections
    if corrections and corrections.folder:
        plural = "" if corrections.number == 1 else "s"
        start = session.path if session.path.suffix != SUFFIX else "MODEL_BEFORE_EXPORT.pt"
        lines.append(
            f"{corrections.number} correction{plural} in {corrections.folder}. To learn from them: python model.py "
            f"--recipe {session.recipe} --start {start} --data {corrections.parent} --data RECORDINGS_BEFORE "
            "--out corrected.pt"
        )
    return lines


if __name__ == "__main__":
    sys.exit(main())
