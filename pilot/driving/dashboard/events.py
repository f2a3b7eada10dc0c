"""Server-sent events of the page: the state of the drive and the camera image, ten times per second."""

import base64
import json
import time
from collections.abc import Iterator
from typing import Any

import cv2
import eventlet
from eventlet import tpool
from eventlet.semaphore import Semaphore

from pilot.arrays import Frame
from pilot.driving.dashboard.state import DriveState
from pilot.driving.drive_session import DriveSession
from pilot.driving.telemetry import Telemetry
from pilot.model.checkpoint import Model
from pilot.model.saliency import overlay, saliency

EVENT_SECONDS = 0.1  # between events; ten per second suffice, and delay the driving little
MOST_STREAMS = 16  # pages that are open at the same time; all of them together take a few percent of one core


class TooManyStreams(RuntimeError):
    """As many pages as allowed are open."""


class Events:
    """Streams of events, limited in number, for which the saliency is drawn at most ten times per second.

    Attributes:
        open: number of streams that are being sent.
    """

    def __init__(self, state: DriveState, session: DriveSession) -> None:
        """Create the events of a drive; the model of `session` is used for the saliency."""
        self.state, self.session = state, session
        self.open = 0
        self._drawing = Semaphore()
        self._drawn, self._drawn_at = b"", float("-inf")  # JPEG with saliency, and its time in s

    def stream(self, *, with_saliency: bool) -> Iterator[str]:
        """Return a stream of events without end: a snapshot of the state, with the frame if it is new.

        Raises:
            TooManyStreams: there are `MOST_STREAMS` already.
        """
        if self.open >= MOST_STREAMS:
            raise TooManyStreams(f"{MOST_STREAMS} pages are open already: close one")
        return self._stream(with_saliency=with_saliency)

    def _stream(self, *, with_saliency: bool) -> Iterator[str]:
        self.open += 1
        try:
            since, shown = 0.0, None
            while True:
                snapshot = self.state.snapshot(since) | self._recorded()
                since = snapshot["samples"][-1]["time"] if snapshot["samples"] else since
                telemetry = self.state.answer.telemetry if self.state.answer else None
                if telemetry is not None and telemetry is not shown:
                    shown = telemetry
                    model = self.session.model
                    if with_saliency and isinstance(model, Model):
                        jpeg = self._draw_saliency(model, telemetry)
                    else:
                        jpeg = telemetry.jpeg
                    snapshot["frame"] = base64.b64encode(jpeg).decode()
                yield f"data: {json.dumps(snapshot)}\n\n"
                eventlet.sleep(EVENT_SECONDS)
        finally:
            self.open -= 1

    def _recorded(self) -> dict[str, Any]:
        recorder, corrections = self.session.recorder, self.session.corrections
        return {
            "model": self.session.path.name,
            "network": self.session.model.name,
            "has_saliency": isinstance(self.session.model, Model),
            "recording": str(recorder.folder) if recorder else "",
            "recorded_frames": recorder.frames if recorder else 0,
            "recording_failed": (recorder.failed or "") if recorder else "",
            "corrections": corrections.number if corrections else 0,
            "corrections_folder": str(corrections.folder or "") if corrections else "",
        }

    def _draw_saliency(self, model: Model, telemetry: Telemetry) -> bytes:
        """Return the frame with its saliency as JPEG, or one that was drawn for another stream just before."""
        with self._drawing:
            if time.monotonic() - self._drawn_at >= EVENT_SECONDS:
                # in a native thread, so that telemetry is answered meanwhile
                self._drawn = tpool.execute(_saliency_jpeg, model, telemetry.frame)
                self._drawn_at = time.monotonic()
            return self._drawn


def _saliency_jpeg(model: Model, frame: Frame) -> bytes:
    """Return the frame with its saliency drawn into it, as JPEG."""
    picture = overlay(frame, saliency(model.network, frame))
    return cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
