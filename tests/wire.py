"""The simulator's side of the wire, in raw WebSocket frames, as its transcript has them.

Not python-socketio's client: that one speaks the newer protocol correctly, which is just what the
simulator does not do.
"""

import base64
import json
import os
import socket
import struct
import time
from typing import Any

import cv2
import numpy as np

PING_SECONDS = 25
FRAGMENT = 1016  # websocket-sharp cuts messages into frames of this size
HANDSHAKE = (
    "GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def jpeg(frame: np.ndarray, quality: int = 75) -> bytes:
    """A 160x320x3 RGB frame as JPEG."""
    blue_first = np.ascontiguousarray(frame[:, :, ::-1])
    return cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def telemetry(
    image: bytes, *, speed: str = "12.3456", steering: str = "2.5000", throttle: str = "0.2000"
) -> dict[str, str]:
    """The argument of a telemetry event: strings all."""
    text = base64.b64encode(image).decode()
    return {"steering_angle": steering, "throttle": throttle, "speed": speed, "image": text}


class WireClient:
    """A connection as the simulator's: pings first, never says `40`, lets the kernel delay small packets."""

    def __init__(self, port: int, timeout: float = 5.0) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout)
        self.buffer = b""
        self.pinged = time.monotonic()
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(HANDSHAKE.format(port=port, key=key).encode())
        while b"\r\n\r\n" not in self.buffer:
            self._receive()
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        assert head.startswith(b"HTTP/1.1 101"), head

    def __enter__(self) -> "WireClient":
        return self

    def __exit__(self, *_error: object) -> None:
        self.socket.close()

    # Frames

    def frame(self, payload: bytes, opcode: int, *, final: bool = True) -> None:
        """Send one masked frame."""
        size, mask = len(payload), os.urandom(4)
        length = bytes([0x80 | size]) if size < 126 else (
            struct.pack("!BH", 0x80 | 126, size) if size < 1 << 16 else struct.pack("!BQ", 0x80 | 127, size))
        masked = np.frombuffer(payload, np.uint8) ^ np.resize(np.frombuffer(mask, np.uint8), size)
        self.socket.sendall(bytes([(0x80 if final else 0) | opcode]) + length + mask + masked.tobytes())

    def send(self, packet: str) -> None:
        """Send a text packet, cut into frames as websocket-sharp does."""
        data = packet.encode()
        parts = [data[start : start + FRAGMENT] for start in range(0, len(data), FRAGMENT)] or [b""]
        for number, part in enumerate(parts):
            self.frame(part, 0 if number else 1, final=number == len(parts) - 1)

    def receive(self) -> str:
        """The next text packet.

        Raises:
            ConnectionError: the server closed the connection.
            TimeoutError: nothing came in time.
        """
        while True:
            first, length = self._exactly(2)
            if length == 126:
                (length,) = struct.unpack("!H", self._exactly(2))
            elif length == 127:
                (length,) = struct.unpack("!Q", self._exactly(8))
            payload = self._exactly(length)
            if first & 15 == 8:
                raise ConnectionError("closed by the server")
            if first & 15 == 1:
                return payload.decode()

    def _exactly(self, count: int) -> bytes:
        while len(self.buffer) < count:
            self._receive()
        data, self.buffer = self.buffer[:count], self.buffer[count:]
        return data

    def _receive(self) -> None:
        data = self.socket.recv(1 << 16)
        if not data:
            raise ConnectionError("closed by the server")
        self.buffer += data

    # Packets

    def connect(self) -> None:
        """What both sides say until the first telemetry."""
        self.send("2")
        greetings = [self.receive() for _ in range(3)]
        assert greetings[0].startswith("0{"), greetings
        assert sorted(greetings[1:]) == ["3", "40"], greetings

    def event(self, name: str, argument: Any) -> None:
        """Send an event."""
        self.send("42" + json.dumps([name, argument]))

    def answer(self) -> tuple[str, Any]:
        """The next event of the server: its name and argument."""
        if time.monotonic() - self.pinged > PING_SECONDS:
            self.pinged = time.monotonic()
            self.send("2")
        while not (packet := self.receive()).startswith("42"):
            pass
        name, argument = json.loads(packet[2:])
        return name, argument


def drive(client: WireClient, message: str, steers: int) -> list[float]:
    """Two tokens in lock-step: each answer earns one telemetry. Returns the seconds from telemetry to answer."""
    sent = []
    for _ in range(2):
        sent.append(time.perf_counter())
        client.send(message)
    seconds = []
    for _ in range(steers):
        name, argument = client.answer()
        assert name == "steer", (name, argument)
        seconds.append(time.perf_counter() - sent.pop(0))
        sent.append(time.perf_counter())
        client.send(message)
    return seconds
