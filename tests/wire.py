"""The simulator's side of the wire for tests and benchmarks: blocking, and without a car."""

import base64
import json
import socket
import time
from typing import Any

from pilot.simulator.wire.connection import Connection, build_frame, parse_event


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def telemetry(
    image: bytes, *, speed: str = "12.3456", steering: str = "2.5000", throttle: str = "0.2000"
) -> dict[str, str]:
    """The argument of a telemetry event: strings all."""
    text = base64.b64encode(image).decode()
    return {"steering_angle": steering, "throttle": throttle, "speed": speed, "image": text}


class WireClient(Connection):
    """A connection to this computer; leaves without a word."""

    def __init__(self, port: int, timeout: float = 5.0) -> None:
        super().__init__(port, timeout=timeout)
        try:
            self.open()
        except OSError:
            self.socket.close()
            raise

    def close(self) -> None:
        self.socket.close()

    def frame(self, payload: bytes, opcode: int, *, final: bool = True) -> None:
        """Send one masked frame."""
        self.socket.sendall(build_frame(payload, opcode, final=final))

    def receive(self) -> str:
        """The next text packet.

        Raises:
            ConnectionError: the server closed the connection.
            TimeoutError: nothing came in the socket's timeout.
        """
        packet = self.poll(self.socket.gettimeout() or 0.0)
        if packet is None:
            raise TimeoutError("no packet in time")
        return packet

    def connect(self) -> None:
        """What both sides say until the first telemetry."""
        greetings = [self.receive() for _ in range(3)]
        assert greetings[0].startswith("0{"), greetings
        assert sorted(greetings[1:]) == ["3", "40"], greetings

    def event(self, name: str, argument: Any) -> None:
        """Send an event."""
        self.send("42" + json.dumps([name, argument]))

    def answer(self) -> tuple[str, Any]:
        """The next event of the server: its name and argument."""
        while not (packet := self.receive()).startswith("42"):
            pass
        return parse_event(packet)


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
