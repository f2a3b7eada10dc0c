"""Examination of recordings in the background: from the quick tests to those that take minutes."""

import logging
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np

from pilot.arrays import Floats
from pilot.data.batches import Batch
from pilot.data.frames import UnreadableImage
from pilot.driving.driver import steering_on
from pilot.driving.plan import SteeringPolicy
from pilot.inspection.cross_check import cross_predictions
from pilot.inspection.inspected import InspectedRecording
from pilot.inspection.motion_seen import see_motion
from pilot.inspection.place_seen import see_place
from pilot.inspection.suspicion import scores_of_images, scores_of_places, scores_of_predictions
from pilot.progress import ProgressBar

log = logging.getLogger("pilot")

Item = TypeVar("Item")


class Examiner:
    """Examines recordings one after another in a thread, which ends with the program."""

    def __init__(
        self, recordings: Sequence[InspectedRecording], driver: SteeringPolicy | None, *, networks: bool = True
    ) -> None:
        """Create an examiner.

        Args:
            recordings: to examine.
            driver: model whose steering is shown beside the label; None: no model.
            networks: also train networks on the halves of each recording.
        """
        self.recordings, self.driver, self.networks = recordings, driver, networks

    def start(self) -> threading.Thread:
        """Start the thread."""
        thread = threading.Thread(target=self.run, name="examiner", daemon=True)
        thread.start()
        return thread

    def run(self) -> None:
        """Examine all recordings: the quick tests of all first."""
        steps: list[Callable[[InspectedRecording], None]] = [self._look, self._steer]
        for step in [*steps, self._train] if self.networks else steps:
            for recording in self.recordings:
                try:
                    step(recording)
                    recording.state = "waiting"
                except (UnreadableImage, ValueError, OSError) as error:  # the others are examined nevertheless
                    log.warning("%s: %s", recording.folder, error)
                    recording.state = str(error)
        for recording in self.recordings:
            recording.state = "" if recording.state == "waiting" else recording.state

    def _look(self, recording: InspectedRecording) -> None:
        rows = recording.rows
        seen = see_motion(rows["center"].tolist(), shown(recording, "looking at the images"))
        recording.scores = {**recording.scores, **scores_of_images(rows, seen)}
        place = see_place(rows, shown(recording, "looking at the road"))
        recording.scores = {**recording.scores, **scores_of_places(rows, place)}

    def _steer(self, recording: InspectedRecording) -> None:
        if self.driver is not None:
            bar = shown(recording, "the model steers")
            recording.predicted = np.array(list(bar(steering_on(self.driver, recording.rows), len(recording.rows), "")))

    def _train(self, recording: InspectedRecording) -> None:
        def bar(number: int) -> ProgressBar[Batch]:
            return shown(recording, f"training network {number + 1} of 2")

        predicted: Floats = cross_predictions(recording.rows, progress=bar)
        recording.scores = {**recording.scores, **scores_of_predictions(recording.rows, predicted)}


def shown(recording: InspectedRecording, what: str) -> Callable[[Iterable[Item], int, str], Iterable[Item]]:
    """Return a progress bar that is shown as the recording's state."""

    def wrap(items: Iterable[Item], total: int, _title: str, /) -> Iterable[Item]:
        done = 0
        for item in items:
            recording.state = f"{what} ({min(100 * done // max(total, 1), 100)} %)"
            yield item
            done += getattr(item, "size", 64 if isinstance(items, range) else 1)

    return wrap
