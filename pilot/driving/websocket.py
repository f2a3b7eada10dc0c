"""The WebSocket below Socket.IO, prompt and forgiving.

Three things in it cost most of a round trip when left as they are: eventlet unmasks a telemetry byte
by byte in Python, reads each of its twenty fragments with four system calls, and Linux holds back
the acknowledgement that websocket-sharp waits for, as it never sets TCP_NODELAY. And Engine.IO ends
the connection at the first packet it does not understand.
"""

import contextlib
import json
import socket
from typing import Any

import numpy as np
from engineio.async_drivers.eventlet import WebSocketWSGI
from eventlet.greenio import GreenSocket
from eventlet.websocket import FailedConnectionError, RFC6455WebSocket

LARGEST_MESSAGE = 4 << 20  # bytes; a telemetry has about 20,000
READ_SIZE = 1 << 16
QUICK_ACK = getattr(socket, "TCP_QUICKACK", None)  # Linux only
UNKNOWN = "unknown"  # the event that anything not understood is turned into


class PromptSocket(GreenSocket):  # type: ignore[misc]
    """A green socket that reads ahead and acknowledges at once; as a listener it accepts such."""

    _ahead = b""

    def accept(self) -> tuple["PromptSocket", Any]:
        """Wait for a connection; its small messages leave at once."""
        client, address = super().accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return client, address

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Up to `size` bytes, b"" at the end."""
        if not self._ahead:
            self._ahead = super().recv(READ_SIZE, flags)
            self._acknowledge()
        data, self._ahead = self._ahead[:size], self._ahead[size:]
        return data

    def _acknowledge(self) -> None:
        """Linux falls back to delayed acknowledgements by itself, so this is said after every read."""
        if QUICK_ACK is not None:
            with contextlib.suppress(OSError):
                self.setsockopt(socket.IPPROTO_TCP, QUICK_ACK, 1)


class PromptWebSocket(RFC6455WebSocket):  # type: ignore[misc]
    """A WebSocket that unmasks fast, bounds the size of a message, and hands on only what is understood."""

    class Message(RFC6455WebSocket.Message):  # type: ignore[misc]
        """A message under way, of bounded size."""

        size = 0

        def push(self, data: bytes, final: bool = False) -> None:
            """Add a fragment.

            Raises:
                FailedConnectionError: the message grows too large.
            """
            self.size += len(data)
            if self.size > LARGEST_MESSAGE:
                raise FailedConnectionError(1009, f"message above {LARGEST_MESSAGE} bytes")
            super().push(data, final)

    @staticmethod
    def _apply_mask(data: bytes, mask: tuple[int, ...], length: int | None = None, offset: int = 0) -> bytes:
        size = len(data) if length is None else length
        turned = np.array([mask[(offset + index) % 4] for index in range(4)], np.uint8)
        return (np.frombuffer(data, np.uint8, size) ^ np.resize(turned, size)).tobytes()

    def wait(self) -> str | None:
        """The next packet that Engine.IO understands, None at the end."""
        packet = super().wait()
        return None if packet is None else understand(packet)


def understand(packet: str | bytes) -> str:
    """A packet as Engine.IO may have it: pings, events and farewells; anything else as an event `unknown`."""
    if isinstance(packet, str) and (packet.startswith(("42[", "2")) or packet in ("1", "40", "41")):
        return packet
    what = packet[:40] if isinstance(packet, str) else f"{len(packet)} bytes"
    return f"42{json.dumps([UNKNOWN, what])}"


class TolerantJson:
    """JSON for Socket.IO in which whatever is no telemetry reads as an event `unknown`, never as an error."""

    dumps = staticmethod(json.dumps)

    @staticmethod
    def loads(text: str) -> Any:
        """The event in a packet, [name, argument].

        Raises:
            ValueError: no event begins here (Engine.IO tries each packet as JSON before Socket.IO does).
        """
        if not text.startswith("["):
            raise ValueError("no event")
        with contextlib.suppress(ValueError, RecursionError):
            event = json.loads(text)
            if event and event[0] in ("telemetry", UNKNOWN):
                return event[:2]
        return [UNKNOWN, text[:40]]


class PromptWebSocketWSGI(WebSocketWSGI):  # type: ignore[misc]
    """Engine.IO's WebSocket application with our socket in it."""

    def _handle_hybi_request(self, environ: dict[str, Any]) -> PromptWebSocket:
        plain = super()._handle_hybi_request(environ)
        return PromptWebSocket(
            plain.socket,
            environ,
            plain.version,
            protocol=plain.protocol,
            extensions=plain.extensions,
            max_frame_length=LARGEST_MESSAGE,
        )


def listen(host: str, port: int) -> PromptSocket:
    """Listen on a port that nobody else listens on.

    Raises:
        OSError: the port is taken, or the address is not this machine's; names the cure.
    """
    # not eventlet.listen: it sets SO_REUSEPORT, and two servers would share the port without a word
    try:
        return PromptSocket(socket.create_server((host, port), backlog=16))
    except OSError as error:
        cure = "stop the other program (another drive.py?), or take another --port, which the simulator must then know"
        raise OSError(f"cannot listen on {host}:{port} ({error.strerror or error}): {cure}") from error
