"""Socket.IO server to which the simulator connects.

The simulator uses the old protocol (Engine.IO 3, Socket.IO 2) although it requests EIO=4. Only certain versions of the
packages support this; with others, the simulator fails to connect, or connects and the car does not move.
"""

import logging
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Any

import eventlet
import eventlet.wsgi
import socketio

from pilot.driving.autopilot import Answer, Autopilot
from pilot.driving.connections import REQUEST_SECONDS, Connections, PromptSocket
from pilot.driving.gate import Gate, connection_of
from pilot.driving.websocket import UNKNOWN, BoundedQueue, PromptWebSocketWSGI, TolerantJson
from pilot.interrupt import catch_interrupt

log = logging.getLogger("pilot")

WORKING_VERSIONS = {"python-socketio": "4.6.1", "python-engineio": "3.13.2"}
PING_SECONDS, PING_GRACE = 25, 60  # the simulator pings every 25 s, later when it is busy
RESEND_SECONDS, RESEND_AT_MOST = 1.0, 30.0  # without telemetry until the command is sent again; doubled each time
GONE_SECONDS = 5.0  # without telemetry until another car may take over
Observer = Callable[[Answer], None]


class WrongVersionError(RuntimeError):
    """The installed packages do not support the simulator's protocol."""


def check_versions() -> None:
    """Check that the installed packages support the simulator's protocol.

    Raises:
        WrongVersionError: they do not; the message contains the versions and the command that installs the right ones.
    """
    wrong = {name: found for name, needed in WORKING_VERSIONS.items() if (found := metadata.version(name)) != needed}
    if wrong:
        found = ", ".join(f"{name} {version}" for name, version in wrong.items())
        needed = " ".join(f"{name}=={version}" for name, version in WORKING_VERSIONS.items())
        raise WrongVersionError(
            f"{found}: with this the simulator connects and the car does not move, or it does "
            f"not connect at all. Install what works: pip install {needed}"
        )


class QuietProtocol(eventlet.wsgi.HttpProtocol):  # type: ignore[misc]
    """HTTP without messages about malformed requests, whose content would appear in the terminal."""

    def log_message(self, *_arguments: object) -> None:
        """Print nothing."""


class DriveServer:
    """Server that answers the telemetry of one simulator at a time.

    Attributes:
        autopilot: computes the answers.
        observers: called with each answer after it was sent.
        car: id of the connection whose car is driven; None while there is none.
    """

    def __init__(self, autopilot: Autopilot, observers: Sequence[Observer] = ()) -> None:
        """Create a server; it accepts connections from the call of `serve` on."""
        self.autopilot, self.observers = autopilot, observers
        self.car: str | None = None
        self._last_telemetry = 0.0
        self._resend_after = RESEND_SECONDS
        self._warned: set[str] = set()
        self._connections: dict[str, PromptSocket] = {}  # by Engine.IO's id
        # async_handlers=False: each telemetry message is answered before the next one is read
        self.socketio = socketio.Server(
            async_mode="eventlet", async_handlers=False, json=TolerantJson, ping_interval=(PING_SECONDS, PING_GRACE)
        )
        self.socketio.eio._async |= {"websocket": PromptWebSocketWSGI, "queue": BoundedQueue}
        for name, handler in {
            "connect": self._connect,
            "disconnect": self._disconnect,
            "telemetry": self._telemetry,
            UNKNOWN: self._unknown,
        }.items():
            self.socketio.on(name, handler)

    def serve(self, listener: PromptSocket, page: Callable[..., Any] | None = None, host: str = "127.0.0.1") -> None:
        """Serve until interrupted.

        Args:
            listener: listening socket to which the simulator connects.
            page: WSGI application for all other requests.
            host: address or name to which the listener is bound.

        Raises:
            KeyboardInterrupt: on Ctrl-C or SIGTERM.
        """
        listener.connections = connections = Connections()
        gate = Gate(socketio.WSGIApp(self.socketio, page), host, self.autopilot.warnings.warn)
        tasks = [
            eventlet.spawn(connections.turns.run),
            eventlet.spawn(self._accept, listener, gate),
            eventlet.spawn(self._watch),
            eventlet.spawn(self._clean, connections),
        ]
        # a flag, because a bare `except:` in Engine.IO would swallow a KeyboardInterrupt
        with catch_interrupt() as interrupt:
            while not interrupt.asked and not any(task.dead for task in tasks):
                eventlet.sleep(0.1)
        for task in tasks:
            if task.dead:
                task.wait()  # raises the task's exception
        interrupt.raise_if_asked()

    def _accept(self, listener: PromptSocket, gate: Gate) -> None:
        eventlet.wsgi.server(
            listener,
            gate,
            protocol=QuietProtocol,
            keepalive=False,
            socket_timeout=REQUEST_SECONDS,
            log_output=False,
            debug=False,
        )

    def _clean(self, connections: Connections) -> None:
        """Close connections that are overdue, and what Engine.IO keeps of handshakes that failed."""
        while True:
            eventlet.sleep(1.0)
            connections.close_overdue()
            for name, client in list(self.socketio.eio.sockets.items()):
                if client.closed or (not client.connected and time.time() - client.last_ping > REQUEST_SECONDS):
                    client.close(wait=False, abort=True)
                    self.socketio.eio.sockets.pop(name, None)

    def _connect(self, connection: str, environment: dict[str, Any]) -> None:
        # no "steer" here: it would only add a third telemetry in flight, which increases the latency
        client = connection_of(environment)
        if client is not None:
            self._connections[connection] = client
        self.autopilot.warnings.warn("simulator connected", connection[:6], level=logging.INFO)

    def _disconnect(self, connection: str) -> None:
        self.autopilot.warnings.warn("simulator disconnected", connection[:6], level=logging.INFO)
        self._warned.discard(connection)
        self._connections.pop(connection, None)
        if connection == self.car:
            self._release()

    def _telemetry(self, connection: str, data: Any = None, *_more: Any) -> None:
        if not self._drives(connection):
            self.socketio.emit("manual", {}, room=connection)
            return
        self._last_telemetry, self._resend_after = time.monotonic(), RESEND_SECONDS
        answer = self.autopilot.answer(data)
        self._send(connection, answer)
        for observe in self.observers:
            observe(answer)

    def _unknown(self, connection: str, what: str = "", *_more: Any) -> None:
        self.autopilot.warnings.warn("unknown packet", what)
        if connection == self.car:
            self._send(connection, self.autopilot.safe_command())

    def _send(self, connection: str, answer: Answer) -> None:
        self.socketio.emit(answer.event, answer.message, room=connection)
        eventlet.sleep(0)  # yields, so that the message is sent before the observers run

    def _drives(self, connection: str) -> bool:
        """Return whether this connection's car is driven; it replaces one that has not sent telemetry for a while."""
        if self.car is not None and connection != self.car and time.monotonic() - self._last_telemetry > GONE_SECONDS:
            log.warning("the car (%s) sends no telemetry; another one takes over", self.car[:6])
            self._release()
        if self.car is None:
            self._take(connection)
        if connection != self.car and connection not in self._warned:
            self._warned.add(connection)
            self.autopilot.warnings.warn(
                "a second simulator connected: one car at a time is driven, this one is not. Quit the other one first",
                connection[:6],
            )
        return connection == self.car

    def _take(self, connection: str) -> None:
        self.car = connection
        if connection in self._connections:
            self._connections[connection].driven = True

    def _release(self) -> None:
        if self.car in self._connections:
            self._connections[self.car].driven = False
        self.car = None
        self.autopilot.reset()

    def _watch(self) -> None:
        """Repeat the last command if no telemetry arrives, because a telemetry or an answer may have been lost."""
        while True:
            eventlet.sleep(RESEND_SECONDS / 4)
            if self.car is None or time.monotonic() - self._last_telemetry < self._resend_after:
                continue
            log.warning("no telemetry for %.0f s: sending the last command again", self._resend_after)
            self._resend_after = min(2 * self._resend_after, RESEND_AT_MOST)
            self._send(self.car, self.autopilot.safe_command())
