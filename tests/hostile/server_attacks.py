"""Attacks on drive.py over the network.

Each attack is a function of the server's port and of the time (time.monotonic, in s) at which it has to end; it returns
how often it tried.
"""

import contextlib
import json
import random
import socket
import threading
import time
import zlib
from collections.abc import Callable

import numpy as np
from wire import WireClient, telemetry

from pilot.data.frames import encode_frame
from pilot.simulator.wire.connection import PING, TEXT, build_frame

Attack = Callable[[int, float], int]
MESSAGE = "42" + json.dumps(["telemetry", telemetry(encode_frame(np.full((160, 320, 3), 99, np.uint8)))])
HELLO = "GET /socket.io/?EIO=4&transport={transport} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n"
UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
    "Sec-WebSocket-Version: 13\r\n"
)


def _connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=2)


def _send(client: socket.socket, data: bytes, until: float) -> int:
    """Send as much as the server takes until the time is over; return the number of bytes."""
    view, sent = memoryview(data), 0
    with contextlib.suppress(OSError):
        while sent < len(data) and time.monotonic() < until:
            client.settimeout(max(until - time.monotonic(), 0.01))
            sent += client.send(view[sent : sent + (1 << 20)])
    return sent


def _request(port: int, request: bytes, until: float) -> bytes:
    """Send a request on a connection of its own; return the first line of the response, or nothing."""
    with contextlib.suppress(OSError), _connect(port) as client:
        _send(client, request, until)
        client.settimeout(max(until - time.monotonic(), 0.01))
        return client.recv(4096).partition(b"\r\n")[0]
    return b""


def _flood(message: bytes, count: int) -> Attack:
    """Return the attack that sends one frame as often as `count`, in one write."""

    def attack(port: int, until: float) -> int:
        with contextlib.suppress(OSError), WireClient(port) as client:
            client.connect()
            return _send(client.socket, message * count, until) // len(message)
        return 0

    return attack


def engine_pings(port: int, until: float) -> int:
    """300,000 Engine.IO pings in one write (2 MB)."""
    return _flood(build_frame(b"2", TEXT), 300_000)(port, until)


def websocket_pings(port: int, until: float) -> int:
    """300,000 WebSocket pings in one write."""
    return _flood(build_frame(b"", PING), 300_000)(port, until)


def empty_telemetry(port: int, until: float) -> int:
    """50,000 telemetry messages without content."""
    return _flood(build_frame(b'42["telemetry"]', TEXT), 50_000)(port, until)


def fragments(port: int, until: float) -> int:
    """A message of 300,000 fragments of one byte."""
    return _flood(build_frame(b"x", TEXT, final=False), 300_000)(port, until)


def many_floods(port: int, until: float) -> int:
    """Thirty connections that send telemetry without a pause, and read no answers."""
    message, counts = build_frame(MESSAGE.encode(), TEXT), [0] * 30

    def flood(index: int) -> None:
        counts[index] = _flood(message, 2000)(port, until)

    _together(flood, len(counts))
    return sum(counts)


def _together(action: Callable[[int], None], number: int) -> None:
    threads = [threading.Thread(target=action, args=(index,)) for index in range(number)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def idle_connections(port: int, until: float) -> int:
    """Connections on which nothing is sent, as many as possible."""
    return _hold(port, until, b"")


def unfinished_requests(port: int, until: float) -> int:
    """Requests whose header has no end, as many as possible."""
    return _hold(port, until, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")


def silent_websockets(port: int, until: float) -> int:
    """WebSockets on which nothing is sent, as many as possible."""
    return _hold(port, until, HELLO.format(transport="websocket", host=f"127.0.0.1:{port}", more=UPGRADE).encode())


def _hold(port: int, until: float, beginning: bytes) -> int:
    clients = []
    with contextlib.ExitStack() as stack:
        while time.monotonic() < until and len(clients) < 5000:
            with contextlib.suppress(OSError):
                clients.append(stack.enter_context(_connect(port)))
                clients[-1].sendall(beginning)
            time.sleep(0.001)
            if len(clients) % 900 == 0:  # this process may open few files, too
                stack.close()
    return len(clients)


def reconnections(port: int, until: float) -> int:
    """Cars that connect, send telemetry and leave at once."""
    count = 0
    while time.monotonic() < until:
        with contextlib.suppress(OSError), WireClient(port) as client:
            client.send(MESSAGE)
        count += 1
    return count


def polling_separators(port: int, until: float) -> int:
    """Long-polling payloads of 400 KB that consist of separators."""
    body = b"\x1e" * 400_000
    return _posts(port, until, "/socket.io/?EIO=4&transport=polling", body)


def large_bodies(port: int, until: float) -> int:
    """Requests with bodies of 10 MB."""
    return _posts(port, until, "/speed", b"[" * 10_000_000)


def _posts(port: int, until: float, path: str, body: bytes) -> int:
    head = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/json\r\n"
    request, count = head.encode() + b"Content-Length: %d\r\n\r\n" % len(body) + body, 0
    while time.monotonic() < until:
        _request(port, request, until)
        count += 1
    return count


def page_streams(port: int, until: float) -> int:
    """A hundred pages with saliency."""
    request = f"GET /events?saliency=1 HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()
    with contextlib.ExitStack() as stack:
        clients: list[socket.socket] = []
        while len(clients) < 100 and time.monotonic() < until:
            with contextlib.suppress(OSError):  # refused, or not accepted in time
                clients.append(stack.enter_context(_connect(port)))
                clients[-1].sendall(request)
        while time.monotonic() < until:
            for client in clients:
                client.settimeout(0.001)
                with contextlib.suppress(OSError):
                    client.recv(1 << 20)
    return len(clients)


def image_bombs(port: int, until: float) -> int:
    """Telemetry with PNG images of 30000x30000 pixels, by a car that is not driven, and by requests of its own."""
    bomb = "42" + json.dumps(["telemetry", telemetry(png_bomb(30_000))])
    count = 0
    while time.monotonic() < until:
        with contextlib.suppress(OSError), WireClient(port) as client:
            client.connect()
            client.send(bomb)
            client.answer()
        count += 1
    return count


def png_bomb(size: int) -> bytes:
    """Return a small PNG file (1 MB) that declares, and contains, size x size black pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4) + kind + data + zlib.crc32(kind + data).to_bytes(4)

    rows = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    hundred_rows = rows.compress(bytes(100 * (size + 1))) + rows.flush(zlib.Z_FULL_FLUSH)  # may be repeated
    check = (size * (size + 1) % 65521 << 16 | 1).to_bytes(4)  # Adler-32 of zeros
    data = b"\x78\x01" + size // 100 * hundred_rows + b"\x03\x00" + check
    header = size.to_bytes(4) * 2 + bytes([8, 0, 0, 0, 0])
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def random_bytes(port: int, until: float) -> int:
    """Random bytes instead of requests, and as frames of WebSockets."""
    rng, count = random.Random(0), 0
    while time.monotonic() < until:
        _request(port, rng.randbytes(rng.randrange(2000)), min(until, time.monotonic() + 0.02))
        with contextlib.suppress(OSError), WireClient(port) as client:
            client.connect()
            client.socket.sendall(rng.randbytes(rng.randrange(2000)))
        count += 2
    return count


def damaged_telemetry(port: int, until: float) -> int:
    """Telemetry messages with a random change of a few characters."""
    rng, count = random.Random(0), 0
    while time.monotonic() < until:
        with contextlib.suppress(OSError), WireClient(port) as client:
            client.connect()
            while time.monotonic() < until:
                text = list(MESSAGE)
                for _ in range(rng.randrange(1, 6)):
                    text[rng.randrange(4) if rng.random() < 0.3 else rng.randrange(len(text))] = chr(rng.randrange(256))
                client.send("".join(text))
                client.poll(0.001)
                count += 1
    return count


def rebinding(port: int, until: float) -> int:
    """WebSocket and speed requests of pages of other origins; counts those that were let in."""
    evil, own = f"evil.example:{port}", f"127.0.0.1:{port}"
    body = 'Content-Type: application/json\r\nContent-Length: 9\r\n\r\n{"mph":1}'
    requests = [
        HELLO.format(transport="websocket", host=evil, more=f"Origin: http://{evil}\r\n" + UPGRADE),
        HELLO.format(transport="websocket", host=own, more=f"Origin: http://{evil}\r\n" + UPGRADE),
        HELLO.format(transport="websocket", host=own, more="Origin: null\r\n" + UPGRADE),
        HELLO.format(transport="websocket", host=own, more="Sec-Fetch-Site: cross-site\r\n" + UPGRADE),
        f"POST /speed HTTP/1.1\r\nHost: {evil}\r\nOrigin: http://{evil}\r\n{body}",
        f"POST /speed HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{evil}\r\n{body}",
        f"POST /speed HTTP/1.1\r\nHost: {own}\r\nSec-Fetch-Site: cross-site\r\n{body}",
        f"GET /events HTTP/1.1\r\nHost: {evil}\r\n\r\n",
    ]
    answers = [_request(port, request.encode(), until) for request in requests]
    return sum(not answer.startswith((b"HTTP/1.1 403", b"HTTP/1.1 421")) for answer in answers)


ATTACKS: list[Attack] = [
    engine_pings,
    websocket_pings,
    empty_telemetry,
    fragments,
    many_floods,
    idle_connections,
    unfinished_requests,
    silent_websockets,
    reconnections,
    polling_separators,
    large_bodies,
    page_streams,
    image_bombs,
    random_bytes,
    damaged_telemetry,
]
