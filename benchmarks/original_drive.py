"""A server with the structure of Udacity's original drive.py, with which driving.py compares this project's.

A single telemetry handler decodes the image with Pillow, runs the network without optimisation, prints and emits.
Sockets and WebSocket are eventlet's, unchanged; the connect handler already sends a steer message.
"""

import base64
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import eventlet
import eventlet.wsgi
import numpy as np
import socketio
import torch
from flask import Flask
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.model.checkpoint import load_model


def main(model_file: str, port: int) -> None:
    """Serve the simulator on a port of this computer with a model file."""
    server = socketio.Server()
    network = load_model(Path(model_file)).network
    integral = 0.0

    @server.on("telemetry")  # type: ignore[untyped-decorator]
    def telemetry(_connection: str, data: dict[str, Any] | None) -> None:
        nonlocal integral
        if not data:
            server.emit("manual", data={}, skip_sid=True)
            return
        image = np.asarray(Image.open(BytesIO(base64.b64decode(data["image"]))))
        with torch.no_grad():
            steering = float(network(torch.from_numpy(image.copy()[None])))
        error = 9.0 - float(data["speed"])
        integral += error
        throttle = 0.1 * error + 0.002 * integral
        print(steering, throttle)
        send(steering, throttle)

    @server.on("connect")  # type: ignore[untyped-decorator]
    def connect(connection: str, _environment: dict[str, Any]) -> None:
        print("connect ", connection)
        send(0.0, 0.0)

    def send(steering: float, throttle: float) -> None:
        server.emit("steer", data={"steering_angle": str(steering), "throttle": str(throttle)}, skip_sid=True)

    app = socketio.Middleware(server, Flask(__name__))
    eventlet.wsgi.server(eventlet.listen(("127.0.0.1", port)), app, log_output=False)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
