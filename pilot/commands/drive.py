"""Drive the simulator: python drive.py model.pt [run1] (see --help)."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from pilot import cli, process_settings
from pilot.driving.controller import ControllerConfig

PROGRAM = cli.program("drive.py")


@dataclass(frozen=True)
class ServeConfig:
    """Serve the simulator (Autonomous mode): steer by a trained model, hold a set speed."""

    model: tyro.conf.Positional[Path]
    """The trained model, such as model.pt."""
    run: tyro.conf.Positional[Path | None] = None
    """Record the drive into this folder: frames and driving_log.csv."""
    overwrite: bool = False
    """Replace a recording that is already in the folder."""
    host: str = "127.0.0.1"
    """Address to serve on."""
    port: int = 4567
    """Port to serve on; the simulator looks for 4567."""
    frame_seconds: float | None = None
    """For a simulator that does not run in real time (simulator.py connect --fast): its seconds from one telemetry to
    the next, which are 0.04 there."""
    drive: tyro.conf.OmitArgPrefixes[ControllerConfig] = field(default_factory=ControllerConfig)

    def check(self) -> None:
        """Refuse values that cannot work.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        self.drive.check()
        if self.frame_seconds is not None and not 0 < self.frame_seconds <= 1:
            raise ValueError(f"--frame-seconds {self.frame_seconds:g}: must lie above 0 and up to 1")


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until Ctrl-C, as the options (by default the command line's) say; returns the exit code."""
    config = tyro.cli(ServeConfig, prog=PROGRAM, args=arguments)

    def drive() -> None:
        config.check()
        serve(config)

    return cli.run(PROGRAM, drive, verbose=True)


def serve(config: ServeConfig) -> None:
    """Load the model, listen, drive.

    Raises:
        UnusableModel, WrongVersionError, FolderInUseError, OSError: with the cure in the message.
    """
    process_settings.for_serving()
    # imported here: --help and wrong options need not wait for torch
    from pilot.driving.autopilot import Autopilot, FrameClock
    from pilot.driving.dashboard.page import create_page
    from pilot.driving.dashboard.state import DriveState
    from pilot.driving.driver import Driver
    from pilot.driving.recorder import Recorder
    from pilot.driving.server import DriveServer, check_versions
    from pilot.driving.websocket import listen

    check_versions()
    process_settings.for_driving()
    driver = Driver.load(config.model)
    listener = listen(config.host, config.port)
    clock = FrameClock(config.frame_seconds) if config.frame_seconds else None
    autopilot = Autopilot(driver.steer, config.drive, clock or time.perf_counter)
    state = DriveState(autopilot)
    recorder = Recorder(config.run, overwrite=config.overwrite) if config.run else None
    observers = [state.observe, *([recorder.observe] if recorder else []), *([clock.tick] if clock else [])]
    server = DriveServer(autopilot, observers)
    print(
        f"{config.model} ({driver.model.name}) is ready at {config.drive.speed:g} mph. Start the simulator in "
        f"autonomous mode; watch at http://{config.host}:{config.port}/ (Ctrl-C ends)",
        flush=True,
    )
    try:
        server.serve(listener, create_page(state, driver.model))
    finally:
        if recorder:
            recorder.close()
            print(f"\n{recorder.frames} frames in {config.run}. For a clip: python video.py {config.run}")


if __name__ == "__main__":
    sys.exit(main())
