"""Flask application of the page: static files, a stream of events, and the requests by which the user intervenes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from eventlet import tpool
from flask import Flask, Response, request

from pilot.driving.dashboard.events import Events, TooManyStreams
from pilot.driving.dashboard.state import DriveState
from pilot.driving.drive_session import DriveSession
from pilot.driving.wheel import PersonCommand
from pilot.vehicle import TOP_SPEED_MPH

Reply = tuple[dict[str, Any], int]


class BadRequest(ValueError):
    """The request's body does not say what is needed; the message does."""


def create_page(state: DriveState, session: DriveSession) -> Flask:
    """Create the application.

    Its routes are `/` (the page), `/events` (server-sent events; with `?saliency=1` the frames show the saliency),
    `/models` (the models that can be chosen), and these, to which JSON is posted:

    - `/speed` with `mph` sets the target speed.
    - `/wheel` with `steering` and `throttle` (-1..1; null: the speed controller goes on) takes over from the model, for
      half a second; with `steering` null, the model steers again.
    - `/model` with `name` lets another model drive.
    - `/recording` with `on` (true or false) starts or ends a recording.

    Args:
        state: of the drive that is shown.
        session: with what is changed while driving.
    """
    events = Events(state, session)
    app = Flask(__name__, static_folder=str(Path(__file__).parent / "static"), static_url_path="/static")

    @app.get("/")
    def page() -> Response:
        return app.send_static_file("index.html")

    @app.get("/events")
    def stream() -> Response:
        try:
            lines = events.stream(with_saliency=request.args.get("saliency") == "1")
        except TooManyStreams as error:
            return Response(str(error), 503, mimetype="text/plain")
        return Response(lines, mimetype="text/event-stream", headers={"Cache-Control": "no-store"})

    @app.get("/models")
    def models() -> Reply:
        return {"models": [path.name for path in session.models()], "model": session.path.name}, 200

    changes: dict[str, Callable[[DriveSession, Any], dict[str, Any]]] = {
        "speed": set_speed,
        "wheel": hold_wheel,
        "model": choose_model,
        "recording": switch_recording,
    }

    @app.post("/<any(speed, wheel, model, recording):what>")
    def change(what: str) -> Reply:
        try:
            return changes[what](session, _body()), 200
        except (ValueError, OSError) as error:
            return {"error": str(error)}, 400

    return app


def set_speed(session: DriveSession, body: dict[str, Any]) -> dict[str, Any]:
    """Set the target speed."""
    wanted = _number(body, "mph", 0, TOP_SPEED_MPH)
    session.autopilot.speed.set_speed = wanted
    return {"set_speed": wanted}


def hold_wheel(session: DriveSession, body: dict[str, Any]) -> dict[str, Any]:
    """Let the person steer, or the model again."""
    wheel = session.autopilot.wheel
    if "steering" in body and body["steering"] is None:
        wheel.release()
        return {"steerer": "model"}
    throttle = _number(body, "throttle", -1, 1) if body.get("throttle") is not None else None
    wheel.hold(PersonCommand(_number(body, "steering", -1, 1), throttle))
    return {"steerer": "person"}


def choose_model(session: DriveSession, body: dict[str, Any]) -> dict[str, Any]:
    """Let another model drive."""
    name = body.get("name")
    if not isinstance(name, str):
        raise BadRequest("send JSON with name, that of a model's file")
    tpool.execute(session.load, name)  # in a native thread, so that telemetry is answered meanwhile
    return {"model": session.path.name}


def switch_recording(session: DriveSession, body: dict[str, Any]) -> dict[str, Any]:
    """Start or end a recording."""
    if body.get("on") is True:
        session.record()
    elif body.get("on") is False:
        tpool.execute(session.stop_recording)  # waits for the disk
    else:
        raise BadRequest("send JSON with on, true or false")
    return {"recording": str(session.recorder.folder) if session.recorder else ""}


def _body() -> dict[str, Any]:
    """Return the JSON object that was sent; an empty one if it is none."""
    try:
        body = json.loads(request.get_data()) if request.is_json else None
    except (ValueError, RecursionError):
        return {}
    return body if isinstance(body, dict) else {}


def _number(body: dict[str, Any], name: str, least: float, most: float) -> float:
    value = body.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise BadRequest(f"send JSON with {name}, a number in {least:g}..{most:g}")
    return float(value)
