"""Flask application of the page: static files, a stream of events, and changes of the target speed."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import eventlet
from eventlet import tpool
from flask import Flask, Response, request

from pilot.arrays import Frame
from pilot.driving.dashboard.state import DriveState
from pilot.model.checkpoint import Model
from pilot.model.saliency import overlay, saliency
from pilot.vehicle import TOP_SPEED_MPH

EVENT_SECONDS = 0.1  # between events; ten per second suffice, and delay the driving little


def create_page(state: DriveState, model: Model) -> Flask:
    """Create the application.

    Its routes are `/` (the page), `/events` (server-sent events; with `?saliency=1` the frames show the saliency) and
    `/speed` (POST of JSON with `mph`: sets the target speed).

    Args:
        state: of the drive that is shown.
        model: for the saliency.
    """
    app = Flask(__name__, static_folder=str(Path(__file__).parent / "static"), static_url_path="/static")

    @app.get("/")
    def page() -> Response:
        return app.send_static_file("index.html")

    @app.get("/events")
    def events() -> Response:
        glowing = request.args.get("saliency") == "1"
        stream = _events(state, model, saliency_wanted=glowing)
        return Response(stream, mimetype="text/event-stream", headers={"Cache-Control": "no-store"})

    @app.post("/speed")
    def speed() -> tuple[dict[str, Any], int]:
        wanted = (request.get_json(silent=True) or {}).get("mph") if request.is_json else None
        if not isinstance(wanted, int | float) or not 0 <= wanted <= TOP_SPEED_MPH:
            return {"error": f"send JSON with mph, a number in 0..{TOP_SPEED_MPH:g}"}, 400
        state.autopilot.speed.set_speed = float(wanted)
        return {"set_speed": float(wanted)}, 200

    return app


def _events(state: DriveState, model: Model, *, saliency_wanted: bool) -> Iterator[str]:
    """Yield server-sent events: a snapshot, with the frame if it is new."""
    since, number = 0.0, -1
    while True:
        snapshot = state.snapshot(since)
        since = snapshot["samples"][-1]["time"] if snapshot["samples"] else since
        if state.number != number and state.answer and state.answer.telemetry:
            telemetry = state.answer.telemetry
            # in a native thread, so that telemetry is answered meanwhile
            jpeg = tpool.execute(_saliency_jpeg, model, telemetry.frame) if saliency_wanted else telemetry.jpeg
            snapshot["frame"] = base64.b64encode(jpeg).decode()
        number = state.number
        yield f"data: {json.dumps(snapshot)}\n\n"
        eventlet.sleep(EVENT_SECONDS)


def _saliency_jpeg(model: Model, frame: Frame) -> bytes:
    """Return the frame with its saliency drawn into it, as JPEG."""
    picture = overlay(frame, saliency(model.network, frame))
    return cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
