"""Flask application of the data page."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from flask import Flask, Response, abort, request

from pilot.data.frames import UnreadableImage, read_frame
from pilot.inspection.inspected import InspectedRecording
from pilot.vehicle import CAMERAS
from pilot.video.overlays import AMBER, draw_path

Reply = tuple[dict[str, Any], int]
SCALE = 2  # of the shown images
QUALITY = 80


def create_app(recordings: Sequence[InspectedRecording], model: str = "") -> Flask:
    """Create the application.

    Its routes are `/` (the page), `/recordings` (overview of all), `/recordings/N/series`, `/recordings/N/moments`,
    `/recordings/N/frames/ROW/CAMERA` (JPEG; of the centre camera, with the label's path and the model's), and
    `/recordings/N/left_out`, to which JSON with `first`, `last` (rows) and `reason` is posted, or with `restore`: true.

    Args:
        recordings: under inspection.
        model: name of the model whose steering is shown; "": none.
    """
    app = Flask(__name__, static_folder=str(Path(__file__).parent / "static"), static_url_path="/static")

    def recording(number: int) -> InspectedRecording:
        if not 0 <= number < len(recordings):
            abort(404)
        return recordings[number]

    @app.get("/")
    def page() -> Response:
        return app.send_static_file("index.html")

    @app.get("/recordings")
    def overview() -> dict[str, Any]:
        return {"model": model, "recordings": [each.overview() for each in recordings]}

    @app.get("/recordings/<int:number>/series")
    def series(number: int) -> dict[str, Any]:
        return recording(number).series()

    @app.get("/recordings/<int:number>/moments")
    def moments(number: int) -> dict[str, Any]:
        return {"moments": recording(number).moments()}

    @app.get("/recordings/<int:number>/frames/<int:row>/<camera>")
    def frame(number: int, row: int, camera: str) -> Response:
        return Response(draw_frame(recording(number), row, camera), mimetype="image/jpeg")

    @app.post("/recordings/<int:number>/left_out")
    def left_out(number: int) -> Reply:
        try:
            change(recording(number), json.loads(request.get_data()) if request.is_json else None)
        except (ValueError, TypeError, KeyError, OSError, RecursionError) as error:
            return {"error": str(error)}, 400
        return {"left_out": recording(number).left_out.tolist()}, 200

    return app


def change(recording: InspectedRecording, body: Any) -> None:
    """Leave a range out, or restore it.

    Raises:
        ValueError: the body does not say which range.
        OSError: the file cannot be written.
    """
    if not isinstance(body, dict) or not all(type(body.get(name)) is int for name in ("first", "last")):
        raise ValueError("send JSON with first and last, numbers of rows")
    if body.get("restore") is True:
        recording.restore(body["first"], body["last"])
    else:
        recording.leave_out(body["first"], body["last"], str(body.get("reason", ""))[:200])


def draw_frame(recording: InspectedRecording, row: int, camera: str) -> bytes:
    """Return an image as JPEG; aborts with 404 if there is none."""
    if camera not in CAMERAS or not 0 <= row < len(recording.rows) or not recording.rows[camera].iloc[row]:
        abort(404)
    try:
        frame = read_frame(recording.rows[camera].iloc[row])
    except UnreadableImage:
        abort(404)
    if camera == "center":
        frame = cv2.resize(frame, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR).astype(np.uint8)
        if recording.predicted is not None:
            draw_path(frame, float(recording.predicted[row]), AMBER)
        draw_path(frame, float(recording.rows["steering"].iloc[row]))
    return cv2.imencode(".jpg", frame[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
