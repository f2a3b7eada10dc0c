"""WebSocket transport for Socket.IO with low latency, tolerant of unknown packets.

Without these changes, three things cause most of the round-trip time: eventlet unmasks a telemetry message byte by byte
in Python; it reads each of its twenty fragments with four system calls; and Linux delays the acknowledgement for which
websocket-sharp waits, because it never sets TCP_NODELAY. Moreover, Engine.IO closes the connection at the first packet
that it does not know.
"""

import contextlib
import json
import time
from typing import Any

import numpy as np
from engineio.async_drivers.eventlet import WebSocketWSGI
from eventlet.queue import Queue
from eventlet.websocket import FailedConnectionError, RFC6455WebSocket

from pilot.driving.connections import SILENT_SECONDS, PromptSocket

LARGEST_MESSAGE = 1 << 18  # bytes; a telemetry message has about 20,000, with a lossless image 150,000
LONGEST_QUEUE = 100  # packets that wait until a client reads them
UNKNOWN = "unknown"  # name of the event that replaces every unknown packet


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
        if isinstance(self.socket, PromptSocket):
            self.socket.deadline = time.monotonic() + SILENT_SECONDS
        return None if packet is None else replace_unknown(packet)


def replace_unknown(packet: str | bytes) -> str:
    """Return pings, events, connect and disconnect packets unchanged, and an event `unknown` for any other packet."""
    if isinstance(packet, str) and (packet.startswith(("42[", "2")) or packet in ("1", "40", "41")):
        return packet
    what = packet[:40] if isinstance(packet, str) else f"{len(packet)} bytes"
    return f"42{json.dumps([UNKNOWN, what])}"


class BoundedQueue(Queue):  # type: ignore[misc]
    """Queue of Engine.IO packets, which drops those for a client that does not read them."""

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        """Add a packet, or None: the end."""
        if item is None or self.qsize() < LONGEST_QUEUE:
            super().put(item, block, timeout)


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
        environ.pop("HTTP_SEC_WEBSOCKET_EXTENSIONS", None)  # no compression: small messages could become large
        plain = super()._handle_hybi_request(environ)
        return PromptWebSocket(
            plain.socket,
            environ,
            plain.version,
            protocol=plain.protocol,
            max_frame_length=LARGEST_MESSAGE,
        )
