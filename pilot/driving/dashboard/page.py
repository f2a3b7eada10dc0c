"""Flask application of the page: static files, a stream of events, and changes of the target speed."""

import json
from pathlib import Path
from typing import Any

from flask import Flask, Response, request

from pilot.driving.dashboard.events import Events, TooManyStreams
from pilot.driving.dashboard.state import DriveState
from pilot.model.checkpoint import Model
from pilot.vehicle import TOP_SPEED_MPH


def create_page(state: DriveState, model: Model) -> Flask:
    """Create the application.

    Its routes are `/` (the page), `/events` (server-sent events; with `?saliency=1` the frames show the saliency) and
    `/speed` (POST of JSON with `mph`: sets the target speed).

    Args:
        state: of the drive that is shown.
        model: for the saliency.
    """
    events = Events(state, model)
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

    @app.post("/speed")
    def speed() -> tuple[dict[str, Any], int]:
        wanted = _speed_wanted()
        if wanted is None:
            return {"error": f"send JSON with mph, a number in 0..{TOP_SPEED_MPH:g}"}, 400
        state.autopilot.speed.set_speed = wanted
        return {"set_speed": wanted}, 200

    return app


def _speed_wanted() -> float | None:
    """Return the target speed in mph that the request asks for; None if it does not ask for a possible one."""
    try:
        body = json.loads(request.get_data()) if request.is_json else None
    except (ValueError, RecursionError):
        return None
    wanted = body.get("mph") if isinstance(body, dict) else None
    if isinstance(wanted, bool) or not isinstance(wanted, int | float) or not 0 <= wanted <= TOP_SPEED_MPH:
        return None
    return float(wanted)
