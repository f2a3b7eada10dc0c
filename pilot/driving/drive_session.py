"""What can be changed while driving: the model, and whether the drive is recorded."""

import logging
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from pilot.driving.autopilot import Answer, Autopilot
from pilot.driving.corrections import Corrections
from pilot.driving.driver import Driver
from pilot.driving.recorder import Recorder

KINDS = ("*.pt", "*.onnx")  # of model files

log = logging.getLogger("pilot")


class DriveSession:
    """The model that drives, the recording of the drive, and that of its corrections.

    Attributes:
        autopilot: that answers the simulator.
        path: of the model that drives.
        model: that drives.
        corrections: records what a person steers in place of the model; None: nothing is recorded.
        recorder: of the current recording; None while not recording.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        path: Path,
        driver: Driver,
        *,
        runs: Path = Path("runs"),
        corrections: Corrections | None = None,
        now: Callable[[], datetime] = datetime.now,
    ) -> None:
        """Create a session.

        Args:
            autopilot: that answers the simulator.
            path: file of the model.
            driver: the loaded model.
            runs: folder for the recordings that `record` starts.
            corrections: recording of the corrections.
            now: returns the time, after which recordings are named.
        """
        self.autopilot, self.path, self.model, self.runs = autopilot, path, driver.model, runs
        self.corrections, self.now = corrections, now
        self.recorder: Recorder | None = None
        self.recordings: list[Recorder] = []  # all of this session, also the ended ones

    # Model

    def models(self) -> list[Path]:
        """Return the model files beside the one that drives, and itself."""
        return sorted({self.path, *(file for kind in KINDS for file in self.path.parent.glob(kind))})

    def load(self, name: str) -> None:
        """Let another of the `models` drive, given its file's name.

        Raises:
            UnusableModel: it is damaged, or not a model of this program.
            ValueError: there is no such model.
        """
        path = next((path for path in self.models() if path.name == name), None)
        if path is None:
            raise ValueError(f"{name[:80]}: no such model beside {self.path}")
        driver = Driver.load(path)
        self.path, self.model = path, driver.model
        self.autopilot.set_policy(driver)
        log.info("%s drives", path)

    @property
    def recipe(self) -> str:
        """Recipe by which the model can learn from its corrections: that for the simulator that it was made for."""
        for_unity = self.model.config.get("recipe") in ("real", "default", "fine-tune")
        return "fine-tune" if for_unity else "corrections"

    # Recording

    def record_into(self, folder: Path, *, overwrite: bool = False) -> None:
        """Start to record the drive into a folder.

        Raises:
            FolderInUseError: the folder is a file, or contains something that is not to be overwritten.
            OSError: the folder cannot be written to.
        """
        self.recorder = Recorder(folder, overwrite=overwrite)
        self.recordings.append(self.recorder)

    def record(self) -> None:
        """Start to record the drive into a new folder, named after the time; has no effect while recording.

        Raises:
            FolderInUseError, OSError: the folder cannot be written to.
        """
        if self.recorder is None:
            self.record_into(self.runs / f"{self.now():%Y-%m-%d_%H-%M-%S}")

    def stop_recording(self) -> None:
        """End the recording; has no effect while not recording."""
        recorder, self.recorder = self.recorder, None
        if recorder:
            recorder.close()

    def observe(self, answer: Answer) -> None:
        """Record an answer."""
        if self.recorder:
            self.recorder.observe(answer)
        if self.corrections:
            self.corrections.observe(answer)

    def close(self) -> None:
        """End the recordings."""
        self.stop_recording()
        if self.corrections:
            self.corrections.close()
