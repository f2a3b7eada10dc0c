"""The page's HTTP side: static files, a stream of events, and the set speed."""

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

EVENT_SECONDS = 0.1  # ten pictures a second are enough to watch, and leave the car its time


def create_page(state: DriveState, model: Model) -> Flask:
    """The application for http://127.0.0.1:4567/."""
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
    """Server-sent events: a snapshot and, where it is new, the frame."""
    since, number = 0.0, -1
    while True:
        snapshot = state.snapshot(since)
        since = snapshot["samples"][-1]["time"] if snapshot["samples"] else since
        if state.number != number and state.answer and state.answer.telemetry:
            telemetry = state.answer.telemetry
            # a thread of the system, not a green one: the car is answered meanwhile
            jpeg = tpool.execute(_glowing, model, telemetry.frame) if saliency_wanted else telemetry.jpeg
            snapshot["frame"] = base64.b64encode(jpeg).decode()
        number = state.number
        yield f"data: {json.dumps(snapshot)}\n\n"
        eventlet.sleep(EVENT_SECONDS)


def _glowing(model: Model, frame: Frame) -> bytes:
    """The frame with what the network looked at, as JPEG."""
    picture = overlay(frame, saliency(model.network, frame))
    return cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
