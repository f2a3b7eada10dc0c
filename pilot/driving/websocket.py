"""WebSocket transport for Socket.IO with low latency, tolerant of unknown packets.

Without these changes, three things cause most of the round-trip time: eventlet unmasks a telemetry message byte by byte
in Python; it reads each of its twenty fragments with four system calls; and Linux delays the acknowledgement for which
websocket-sharp waits, because it never sets TCP_NODELAY. Moreover, Engine.IO closes the connection at the first packet
that it does not know.
"""

import contextlib
import json
import socket
from typing import Any

import numpy as np
from engineio.async_drivers.eventlet import WebSocketWSGI
from eventlet.greenio import GreenSocket
from eventlet.websocket import FailedConnectionError, RFC6455WebSocket

LARGEST_MESSAGE = 4 << 20  # bytes; a telemetry message has about 20,000
READ_SIZE = 1 << 16
QUICK_ACK = getattr(socket, "TCP_QUICKACK", None)  # Linux only
UNKNOWN = "unknown"  # name of the event that replaces every unknown packet


class PromptSocket(GreenSocket):  # type: ignore[misc]
    """A green socket with read-ahead and immediate acknowledgements; a listening one accepts such sockets."""

    _ahead = b""

    def accept(self) -> tuple["PromptSocket", Any]:
        """Accept a connection, with TCP_NODELAY so that small messages are sent at once."""
        client, address = super().accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return client, address

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Return up to `size` bytes; b"" at the end of the stream."""
        if not self._ahead:
            self._ahead = super().recv(READ_SIZE, flags)
            self._acknowledge()
        data, self._ahead = self._ahead[:size], self._ahead[size:]
        return data

    def _acknowledge(self) -> None:
        """Set TCP_QUICKACK; necessary after every read, because Linux resets it."""
        if QUICK_ACK is not None:
            with contextlib.suppress(OSError):
                self.setsockopt(socket.IPPROTO_TCP, QUICK_ACK, 1)


class PromptWebSocket(RFC6455WebSocket):  # type: ignore[misc]
    """A WebSocket with fast unmasking and limited message size, which replaces packets unknown to Engine.IO."""

    class Message(RFC6455WebSocket.Message):  # type: ignore[misc]
        """A partially received message of limited size."""

        size = 0

        def push(self, data: bytes, final: bool = False) -> None:
            """Add a fragment.

            Raises:
                FailedConnectionError: the message is too large.
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
        """Return the next packet, passed through `replace_unknown`; None at the end of the connection."""
        packet = super().wait()
        return None if packet is None else replace_unknown(packet)


def replace_unknown(packet: str | bytes) -> str:
    """Return pings, events, connect and disconnect packets unchanged, and an event `unknown` for any other packet."""
    if isinstance(packet, str) and (packet.startswith(("42[", "2")) or packet in ("1", "40", "41")):
        return packet
    what = packet[:40] if isinstance(packet, str) else f"{len(packet)} bytes"
    return f"42{json.dumps([UNKNOWN, what])}"


class TolerantJson:
    """JSON module for Socket.IO that decodes everything but telemetry as an event `unknown` instead of failing."""

    dumps = staticmethod(json.dumps)

    @staticmethod
    def loads(text: str) -> Any:
        """Decode an event: [name] or [name, argument].

        Raises:
            ValueError: the text is not an event (Engine.IO tries to decode each packet as JSON before Socket.IO does).
        """
        if not text.startswith("["):
            raise ValueError("no event")
        with contextlib.suppress(ValueError, RecursionError):
            event = json.loads(text)
            if event and event[0] in ("telemetry", UNKNOWN):
                return event[:2]
        return [UNKNOWN, text[:40]]


class PromptWebSocketWSGI(WebSocketWSGI):  # type: ignore[misc]
    """Engine.IO's WebSocket application with `PromptWebSocket` as its socket."""

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
    """Return a socket that listens on a port exclusively.

    Raises:
        OSError: the port is in use, or the address is not this computer's; the message says what to do.
    """
    # not eventlet.listen: it sets SO_REUSEPORT, with which two servers would silently share the port
    try:
        return PromptSocket(socket.create_server((host, port), backlog=16))
    except OSError as error:
        cure = "stop the other program (another drive.py?), or take another --port, which the simulator must then know"
        raise OSError(f"cannot listen on {host}:{port} ({error.strerror or error}): {cure}") from error
