"""Sockets of the server: low latency for the driven car; limits of number, duration and time for all others."""

import contextlib
import errno
import logging
import math
import socket
import sys
import time
from typing import Any

import eventlet
from eventlet.greenio import GreenSocket

from pilot.driving.turns import LONGEST_TURN, Turns

log = logging.getLogger("pilot")

MOST_CONNECTIONS = 64  # a car and some pages; systems allow 256 open files or more
REQUEST_SECONDS = 10.0  # until a request is complete; a browser needs milliseconds
SILENT_SECONDS = 90.0  # without a packet until a WebSocket is closed; simulators ping every 25 s
READ_SIZE = 1 << 16
QUICK_ACK = getattr(socket, "TCP_QUICKACK", None)  # Linux only
EXHAUSTED = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}


class PromptSocket(GreenSocket):  # type: ignore[misc]
    """A green socket with read-ahead and immediate acknowledgements; a listening one accepts such sockets.

    Attributes:
        connections: all sockets accepted by the same listener; None: this one takes no turns.
        driven: whether this is the connection of the driven car, which takes no turns.
        established: whether a complete request has been received.
        deadline: monotonic time in s after which the connection is closed.
        closing: whether it was shut down and is about to be closed.
    """

    connections: "Connections | None" = None
    driven = established = closing = False
    deadline = math.inf
    _ahead = b""
    _turn_began = 0.0

    def accept(self) -> tuple["PromptSocket", Any]:
        """Accept a connection, with TCP_NODELAY so that small messages are sent at once."""
        while True:
            try:
                client, address = super().accept()
            except OSError as error:
                self._recover(error)
                continue
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self.connections is not None:
                self.connections.add(client)
            return client, address

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Return up to `size` bytes; b"" at the end of the stream."""
        if not self._ahead:
            before = time.perf_counter()
            self._ahead = super().recv(READ_SIZE, flags)
            self._acknowledge()
            if self.driven and time.perf_counter() - before > LONGEST_TURN:  # it had to wait, so that others could run
                self._turn_began = time.perf_counter()
            self._take_turn(new=not self.driven)
        else:
            self._take_turn()
        data, self._ahead = self._ahead[:size], self._ahead[size:]
        return data

    def recv_into(self, *arguments: Any) -> int:
        """Read into a buffer (HTTP requests are read so); return the number of bytes."""
        number: int = super().recv_into(*arguments)
        self._take_turn(new=True)
        return number

    def shut(self) -> None:
        """Shut the connection down; the green threads that wait for it then close it."""
        self.closing = True
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def _take_turn(self, *, new: bool = False) -> None:
        """Let others run if this connection has run for the length of a turn, or if it is to take a `new` one."""
        if not new and time.perf_counter() - self._turn_began < LONGEST_TURN:
            return
        if self.connections is None or self.driven:
            eventlet.sleep(0)
        else:
            self.connections.turns.wait()
        self._turn_began = time.perf_counter()

    def _acknowledge(self) -> None:
        """Set TCP_QUICKACK; necessary after every read, because Linux resets it."""
        if QUICK_ACK is not None:
            with contextlib.suppress(OSError):
                self.setsockopt(socket.IPPROTO_TCP, QUICK_ACK, 1)

    def _recover(self, error: OSError) -> None:
        """Make room if the process has too many open files; the listener must not end because of it."""
        if error.errno in EXHAUSTED and self.connections is not None:
            self.connections.make_room(len(self.connections.open) - 1)
            eventlet.sleep(0.1)
        elif error.errno != errno.ECONNABORTED:
            raise error


class Connections:
    """Sockets accepted by a listener, limited in number and duration.

    Attributes:
        turns: that the connections take, except for the driven car's.
        open: sockets that are not closed.
    """

    def __init__(self) -> None:
        """Create the limits; they take effect while `run` runs."""
        self.turns = Turns()
        self.open: list[PromptSocket] = []
        self.limit = connection_limit()

    def add(self, client: PromptSocket) -> None:
        """Add an accepted socket; if there are too many, close another one."""
        client.connections, client.deadline = self, time.monotonic() + REQUEST_SECONDS
        self.make_room(self.limit - 1)
        self.open.append(client)
        self.turns.wait()

    def make_room(self, number: int) -> None:
        """Shut connections down until at most `number` are left: first those without a request, the oldest first."""
        self._forget_closed()
        others = sorted((client for client in self.open if not client.driven), key=lambda client: client.established)
        for client in others[: max(len(self.open) - number, 0)]:
            client.shut()

    def close_overdue(self) -> None:
        """Shut the connections down whose deadline has passed."""
        self._forget_closed()
        for client in self.open:
            if client.deadline < time.monotonic():
                client.shut()

    def _forget_closed(self) -> None:
        self.open = [client for client in self.open if not client.closing and client.fileno() >= 0]


def connection_limit() -> int:
    """Return the number of connections that leaves three quarters of the files that the system allows."""
    if sys.platform == "win32":
        return MOST_CONNECTIONS
    import resource  # noqa: PLC0415 - Windows has none

    return min(MOST_CONNECTIONS, max(resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 4, 4))


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
