"""WebSocket frames and Engine.IO packets exactly as the Unity simulator sends them.

python-socketio's client cannot be used: it implements the protocol version that it requests, whereas the simulator
requests Engine.IO 4 and uses Engine.IO 3.
"""

import base64
import contextlib
import errno
import json
import logging
import os
import select
import socket
import time
from typing import Any, Self

import numpy as np

log = logging.getLogger("pilot")

HOST, PORT = "127.0.0.1", 4567  # address to which the Unity simulator connects
PING_SECONDS, PONG_SECONDS = 25.0, 60.0  # interval of pings; timeout of the answer to a ping
RETRY_SECONDS = 0.5
FRAGMENT = 1016  # bytes; websocket-sharp splits messages into frames of this size
READ_SIZE = 1 << 16
CONTINUATION, TEXT, CLOSE, PING, PONG = 0, 1, 8, 9, 10  # opcodes of WebSocket frames
HANDSHAKE = (
    "GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
)
UNDER_WAY = (0, errno.EINPROGRESS, errno.EWOULDBLOCK)


def build_frame(payload: bytes, opcode: int, *, final: bool = True) -> bytes:
    """Return a WebSocket frame, masked as required of clients."""
    size, mask = len(payload), os.urandom(4)
    if size < 126:
        length = bytes([0x80 | size])
    else:
        length = bytes([0x80 | 126]) + size.to_bytes(2) if size < 1 << 16 else bytes([0x80 | 127]) + size.to_bytes(8)
    masked = np.frombuffer(payload, np.uint8) ^ np.resize(np.frombuffer(mask, np.uint8), size)
    return bytes([(0x80 if final else 0) | opcode]) + length + mask + masked.tobytes()


def build_event(name: str, argument: Any) -> str:
    """Return the packet of a Socket.IO event."""
    return "42" + json.dumps([name, argument], separators=(",", ":"))


def parse_event(packet: str) -> tuple[str, Any]:
    """Return the name and the argument (None if missing) of the packet of a Socket.IO event.

    Raises:
        ValueError: the packet is not an event.
    """
    event = json.loads(packet.removeprefix("42"))
    if not isinstance(event, list) or not event or not isinstance(event[0], str):
        raise ValueError(f"no event: {packet[:40]}")
    return event[0], event[1] if len(event) > 1 else None


class Connection:
    """A single non-blocking connection to a server; only sending blocks if the server does not read.

    Attributes:
        socket: the TCP socket.
        opened: whether the server has accepted the handshake.
    """

    def __init__(self, port: int = PORT, host: str = HOST, *, prompt: bool = False, timeout: float = 5.0) -> None:
        """Start to connect, without waiting.

        Args:
            port, host: address of the server.
            prompt: set TCP_NODELAY and send each packet at once. The Unity simulator does not, so that the kernel may
                delay small packets.
            timeout: s, for the handshake and for sending a packet.

        Raises:
            OSError: the connection failed at once.
        """
        self.opened = False
        self._address, self._prompt, self._timeout = (host, port), prompt, timeout
        self._began = self._pinged = self._heard = time.monotonic()
        self._connected = False
        self._data = self._message = b""
        self.socket = socket.socket()
        self.socket.setblocking(False)
        try:
            self._check(self.socket.connect_ex(self._address))
        except OSError:
            self.socket.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def open(self) -> None:
        """Wait until the server has accepted the handshake.

        Raises:
            OSError: the connection or the handshake failed.
        """
        while not self._accepted():
            self._read(self._timeout)
            self._check_silence()

    def poll(self, timeout: float = 0.0) -> str | None:
        """Return the next text packet; None if there is none within `timeout` seconds.

        Raises:
            ConnectionError: the server closed the connection, does not answer, or refused the handshake.
            TimeoutError: the server did not answer the handshake.
            OSError: another network error.
        """
        deadline = time.monotonic() + timeout
        while True:
            if self._accepted():
                self._keep_alive()
                if (packet := self._packet()) is not None:
                    return packet
            if not self._read(max(deadline - time.monotonic(), 0.0)):
                self._check_silence()
                return None

    def send(self, packet: str) -> None:
        """Send a text packet, split into frames as by websocket-sharp.

        Raises:
            OSError: the connection is closed, or the server does not read.
        """
        data = packet.encode()
        starts = range(0, max(len(data), 1), FRAGMENT)
        frames = [
            build_frame(data[start : start + FRAGMENT], CONTINUATION if start else TEXT, final=start == starts[-1])
            for start in starts
        ]
        for part in [b"".join(frames)] if self._prompt else frames:
            self.socket.sendall(part)

    def close(self) -> None:
        """Disconnect and close, as the Unity simulator does on quitting."""
        with contextlib.suppress(OSError):
            if self.opened:
                self.send("41")
                self.send("1")
                self.socket.sendall(build_frame((1000).to_bytes(2), CLOSE))
                # closing with unread data would reset the connection, and the packets above would be lost
                deadline = time.monotonic() + 1.0
                while time.monotonic() < deadline and self._read(0.2):
                    pass
        self.socket.close()

    # Below: connecting, frames, packets

    def _check(self, error: int) -> None:
        if error not in UNDER_WAY:
            raise OSError(error, os.strerror(error))

    def _check_silence(self) -> None:
        now = time.monotonic()
        if not self.opened and now - self._began > self._timeout:
            raise TimeoutError(f"what listens at {self._address[0]}:{self._address[1]} does not answer the handshake")
        if now - self._heard > PING_SECONDS + PONG_SECONDS:
            raise ConnectionError("the server does not answer pings")

    def _read(self, timeout: float) -> bool:
        """Continue to connect, or read data; return whether there was any progress within `timeout` seconds."""
        if not self._connected:
            return self._request(timeout)
        if not select.select([self.socket], [], [], timeout)[0]:
            return False
        data = self.socket.recv(READ_SIZE)
        if not data:
            raise ConnectionError("the server closed the connection")
        self._data += data
        self._heard = time.monotonic()
        return True

    def _request(self, timeout: float) -> bool:
        """Send the handshake once the TCP connection is established; return whether it was sent."""
        # on Windows, a failed connection attempt is reported in the third list
        _, ready, failed = select.select([], [self.socket], [self.socket], timeout)
        if not (ready or failed):
            return False
        self._check(self.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR))
        self._connected = True
        self.socket.settimeout(self._timeout)
        if self._prompt:
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host, port = self._address
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(HANDSHAKE.format(host=host, port=port, key=key).encode())
        return True

    def _accepted(self) -> bool:
        """Return whether the server has accepted the handshake; send the first ping as soon as it has."""
        if self.opened or b"\r\n\r\n" not in self._data:
            return self.opened
        head, self._data = self._data.split(b"\r\n\r\n", 1)
        status = head.splitlines()[0].decode(errors="replace")
        if not status.startswith("HTTP/1.1 101"):
            raise ConnectionError(
                f"the server refuses the simulator ({status}): other versions of python-socketio "
                "and python-engineio are needed (drive.py names them)"
            )
        self.opened, self._pinged = True, float("-inf")
        self._keep_alive()
        return True

    def _keep_alive(self) -> None:
        if time.monotonic() - self._pinged > PING_SECONDS:
            self._pinged = time.monotonic()
            self.send("2")

    def _packet(self) -> str | None:
        """Return the next complete text packet of the received data; None if there is none."""
        while (frame := self._frame()) is not None:
            first, payload = frame
            opcode = first & 15
            if opcode == CLOSE:
                raise ConnectionError("the server closed the connection")
            if opcode == PING:
                self.socket.sendall(build_frame(payload, PONG))
            if opcode not in (TEXT, CONTINUATION):
                continue
            self._message = payload if opcode == TEXT else self._message + payload
            if first & 0x80:
                return self._message.decode(errors="replace")
        return None

    def _frame(self) -> tuple[int, bytes] | None:
        """Remove the next frame from the received data: first byte and payload; None while it is incomplete."""
        if len(self._data) < 2:
            return None
        size = self._data[1] & 127
        start = {126: 4, 127: 10}.get(size, 2)
        if start > 2:
            size = int.from_bytes(self._data[2:start])
        if len(self._data) < start + size:
            return None
        first, payload = self._data[0], self._data[start : start + size]
        self._data = self._data[start + size :]
        return first, payload


class Link:
    """A persistent connection: waits for a server and reconnects after the connection is lost.

    Attributes:
        connection: the open or opening connection; None between attempts.
        greeted: whether the server has sent its open packet, so that telemetry may be sent.
        greetings: number of open packets received, on all connections.
    """

    def __init__(self, port: int = PORT, host: str = HOST, *, prompt: bool = False) -> None:
        """Create a link; `poll` connects it. The arguments are those of Connection."""
        self.connection: Connection | None = None
        self.greeted, self.greetings = False, 0
        self._port, self._host, self._prompt = port, host, prompt
        self._retry_at = 0.0
        self._said = ""

    def poll(self, timeout: float = 0.0) -> str | None:
        """Return the next text packet; None if there is none, or no server, within `timeout` seconds."""
        if self.connection is None and not self._may_try(timeout):
            return None
        try:
            self.connection = self.connection or Connection(self._port, self._host, prompt=self._prompt)
            packet = self.connection.poll(timeout)
        except OSError as error:
            self._lose(error)
            return None
        if packet is not None and packet.startswith("0"):
            self._greet()
        return packet

    def send(self, packet: str) -> None:
        """Send a text packet; it is dropped if there is no connection."""
        try:
            if self.connection is not None:
                self.connection.send(packet)
        except OSError as error:
            self._lose(error)

    def close(self) -> None:
        """Disconnect from the server, if connected."""
        if self.connection is not None:
            self.connection.close()
        self.connection, self.greeted = None, False

    def _may_try(self, timeout: float) -> bool:
        wait = self._retry_at - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, timeout))
        return wait <= timeout

    def _greet(self) -> None:
        self.greeted, self._said = True, ""
        self.greetings += 1
        log.info("connected to the server at %s:%d", self._host, self._port)

    def _lose(self, error: OSError) -> None:
        if self.greeted:
            self._say(f"connection lost ({error}): reconnecting")
        elif error.errno is None:  # not an error of the operating system: the message says more
            self._say(str(error))
        elif not self._said:
            self._say(
                f"no server at {self._host}:{self._port} ({error.strerror}): waiting for one to start, "
                "such as python drive.py model.pt"
            )
        if self.connection is not None:
            self.connection.socket.close()
        self.connection, self.greeted = None, False
        self._retry_at = time.monotonic() + RETRY_SECONDS

    def _say(self, text: str) -> None:
        if text != self._said:
            log.warning("%s", text)
        self._said = text
