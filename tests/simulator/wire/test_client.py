"""The simulator's side of the drive: what it says to a server, and what it makes of the answers."""

import base64
import json
import logging
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import cv2
import numpy as np
import pytest
from conftest import RADIUS, REPOSITORY, circle, picture
from wire import free_port

from pilot.simulator.episode import CarState, Episode
from pilot.simulator.referee import NEVER, WHEN_LOST, Referee
from pilot.simulator.wire.client import Client, build_telemetry, parse_steer
from pilot.simulator.wire.connection import Connection, parse_event
from pilot.vehicle import curvature_to_steering

EXPERT = curvature_to_steering(1 / RADIUS)
FRAME = picture(0.2)
Answer = Callable[[dict[str, str]], str | None]


def steer(steering: object, throttle: object = "0.5") -> str:
    return "42" + json.dumps(["steer", {"steering_angle": steering, "throttle": throttle}])


def expert(_telemetry: dict[str, str]) -> str:
    return steer(f"{EXPERT:.6f}")


def packet_frame(text: str, first: int = 0x81) -> bytes:
    """A frame as a server sends it."""
    data = text.encode()
    assert len(data) < 1 << 16
    return bytes([first]) + (bytes([len(data)]) if len(data) < 126 else bytes([126]) + len(data).to_bytes(2)) + data


class FakeServer(threading.Thread):
    """Speaks the server's side to one simulator after another; keeps what it hears.

    `answer` makes the packet that a telemetry gets, None for none.
    """

    def __init__(self, answer: Answer, port: int = 0) -> None:
        super().__init__(daemon=True)
        self.answer = answer
        self.packets: list[str] = []
        self.sizes: list[int] = []  # of the frames
        self.request = b""
        self.listener = socket.create_server(("127.0.0.1", port))
        self.port = self.listener.getsockname()[1]
        self.client: socket.socket | None = None

    def run(self) -> None:
        with suppress(OSError, EOFError):
            while True:
                self.client, _ = self.listener.accept()
                with self.client, suppress(OSError, EOFError):
                    self.serve(self.client)

    def serve(self, client: socket.socket) -> None:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with client.makefile("rb") as stream:
            lines = iter(stream.readline, b"\r\n")
            self.request = b"".join(lines)
            client.sendall(b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\n\r\n")
            client.sendall(packet_frame('0{"sid":"x","upgrades":[],"pingTimeout":60000}') + packet_frame("40"))
            while True:
                self.hear(self.packet(stream.read))

    def packet(self, read: Callable[[int], bytes]) -> str:
        message, first = b"", 0
        while not first & 0x80:
            head = read(2)
            if len(head) < 2:
                raise EOFError
            first, size = head[0], head[1] & 127
            assert head[1] & 0x80, "a client must mask"
            size = int.from_bytes(read({126: 2, 127: 8}[size])) if size > 125 else size
            mask, data = np.frombuffer(read(4), np.uint8), np.frombuffer(read(size), np.uint8)
            self.sizes.append(size)
            message += (data ^ np.resize(mask, size)).tobytes()
        return "close" if first & 15 == 8 else message.decode()

    def hear(self, packet: str) -> None:
        self.packets.append(packet)
        if packet == "2":
            self.send("3")
        elif packet == "close":
            raise EOFError
        elif packet.startswith("42"):
            _, data = parse_event(packet)
            if (answer := self.answer(data)) is not None:
                self.send(answer)

    def send(self, packet: str) -> None:
        assert self.client
        self.client.sendall(packet_frame(packet))

    @property
    def telemetry(self) -> list[dict[str, str]]:
        return [parse_event(packet)[1] for packet in self.packets if packet.startswith("42")]

    def stop(self) -> None:
        for each in (self.listener, self.client):
            if each is not None:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self.join(5)


@contextmanager
def serving(answer: Answer, port: int = 0) -> Iterator[FakeServer]:
    server = FakeServer(answer, port)
    server.start()
    try:
        yield server
    finally:
        server.stop()


def client_of(server: FakeServer, episode: Episode | None = None, **options: object) -> Client:
    episode = episode or Episode(circle())
    rule = WHEN_LOST if options.pop("put_back", True) else NEVER
    referee = Referee(episode, laps=options.pop("laps", None), seconds=options.pop("seconds", None), rule=rule)
    return Client(
        episode,
        lambda _: FRAME,
        **{"port": server.port, "realtime": False, "patience": 5.0, "referee": referee, **options},
    )


def until(condition: Callable[[], object], client: Client, seconds: float = 5.0) -> None:
    """Frames of a window, until something is so."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        client.advance(0.01)
        time.sleep(0.01)


# What is said


def test_says_what_the_real_one_says() -> None:
    with serving(expert) as server:
        client_of(server, seconds=0.2, realtime=True).run()
        server.join(0.3)
    assert server.request.startswith(b"GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\n")
    assert server.packets[0] == "2"
    assert [packet[:15] for packet in server.packets[1:3]] == ['42["telemetry",'] * 2
    assert server.packets[-3:] == ["41", "1", "close"]
    telemetry_sizes = server.sizes[1 : 2 + len(server.packets[1]) // 1016]
    assert set(telemetry_sizes[:-1]) == {1016}
    assert sum(telemetry_sizes) == len(server.packets[1])


def test_numbers_are_strings_in_the_wire_s_units() -> None:
    episode = Episode(circle())
    episode.place(0, speed=-4.0)
    episode.advance(0.1, 0.2)
    telemetry = build_telemetry(episode, FRAME)
    assert telemetry["steering_angle"] == "2.5000"
    assert telemetry["throttle"] == "0.2000"
    assert telemetry["speed"] == f"{-episode.state.speed:.4f}"
    episode.advance(-1e-9, -0.5)
    telemetry = build_telemetry(episode, FRAME)
    assert (telemetry["steering_angle"], telemetry["throttle"]) == ("0.0000", "0.0000")
    seen = cv2.imdecode(np.frombuffer(base64.b64decode(telemetry["image"]), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert seen.shape == (160, 320, 3)
    assert np.abs(seen.astype(int) - FRAME).mean() < 3


def test_pings_again_and_answers_pings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pilot.simulator.wire.connection.PING_SECONDS", 0.1)
    with serving(lambda _: None) as server:
        client = client_of(server, realtime=True)
        until(lambda: server.packets.count("2") >= 4, client)
        client.close()


def test_fragments_pings_and_long_frames_of_a_server() -> None:
    with serving(lambda _: None) as server, Connection(server.port) as connection:
        connection.open()
        assert server.client
        heard: set[str | None] = set()
        while not {"40", "3"} <= heard:  # from here on the server's thread is silent: nothing slips into our frames
            heard.add(connection.poll(1))
        server.client.sendall(packet_frame("42[", 0x01) + packet_frame("hello", 0x89) + packet_frame('"x"', 0x00))
        server.client.sendall(packet_frame("]", 0x80)[:-1])
        assert connection.poll(0.2) is None  # the last byte is missing
        server.client.sendall(b"]" + packet_frame("y" * 50_000) + packet_frame("1") + packet_frame("", 0x88))
        assert [connection.poll(1) for _ in range(3)] == ['42["x"]', "y" * 50_000, "1"]
        with pytest.raises(ConnectionError, match="closed"):
            connection.poll(1)
        server.join(0.1)
        assert "hello" in server.packets


def test_connecting_does_not_wait_for_a_server_that_is_busy() -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=0) as listener:
        port = listener.getsockname()[1]
        began = time.monotonic()
        connections = [Connection(port, timeout=0.1) for _ in range(4)]  # more than the kernel takes in
        assert [connection.poll() for connection in connections] == [None] * 4
        assert time.monotonic() - began < 0.1
        time.sleep(0.1)
        for connection in connections:
            with connection, pytest.raises(TimeoutError, match="handshake"):
                connection.poll()


def test_a_server_that_refuses_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener, Connection(listener.getsockname()[1]) as connection:
        assert connection.poll() is None  # does not wait
        with listener.accept()[0] as client:
            assert connection.poll(0.1) is None
            client.sendall(b"HTTP/1.1 400 BAD REQUEST\r\n\r\n")
            with pytest.raises(ConnectionError, match=r"400 BAD REQUEST.*python-engineio"):
                connection.poll(1)


def test_a_refusal_is_told_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr("pilot.simulator.wire.connection.RETRY_SECONDS", 0.02)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(5)
        client = Client(Episode(circle()), lambda _: FRAME, port=listener.getsockname()[1])
        for _ in range(3):
            client.advance(0.01)
            with listener.accept()[0] as server:
                server.sendall(b"HTTP/1.1 400 BAD REQUEST\r\n\r\n")
                until(lambda: client._link.connection is None, client)
            time.sleep(0.03)
    assert ["400 BAD" in record.message for record in caplog.records] == [True]


# Tokens


@pytest.mark.parametrize("realtime", [False, True])
def test_two_tokens_are_in_flight_and_each_answer_earns_one(realtime: bool) -> None:
    with serving(lambda _: None) as server:
        client = client_of(server, realtime=realtime)

        def settle(telemetries: int) -> None:
            for _ in range(12):
                client.advance(0.005) if realtime else client.step(0.005)
                time.sleep(0.005)
            assert len(server.telemetry) == telemetries

        settle(2)
        for number in range(3):
            server.send(steer("0.1") if number != 1 else '42["manual",{}]')
            settle(3 + number)
        server.send('42["hello",{}]')
        settle(5)
        assert client.answers == 3
        client.close()


def test_at_most_60_telemetries_a_second_in_real_time() -> None:
    with serving(expert) as server:
        client = client_of(server, realtime=True)
        client._link._prompt = True  # the kernel's delays would slow it down as well
        until(lambda: client.answers, client)
        sent, end = len(server.telemetry), time.monotonic() + 0.4
        while time.monotonic() < end:  # 300 frames a second or so
            client.advance(0.003)
            time.sleep(0.003)
        client.close()
    assert 16 <= len(server.telemetry) - sent <= 28


@pytest.mark.parametrize(
    "bad",
    [
        steer(0.1),
        steer("nan"),
        steer("[0.1]"),
        steer("0.1", None),
        steer(""),
        steer("1e999"),
        '42["steer"]',
        '42["steer",[]]',
        '42["steer",',
    ],
)
def test_a_steer_that_is_no_string_loses_its_token(bad: str, caplog: pytest.LogCaptureFixture) -> None:
    answers = [steer("0.5"), bad, steer("0.6"), bad]
    with serving(lambda _: answers.pop(0)) as server:
        client = client_of(server)
        for _ in range(30):
            client.step(0.005)
        assert len(server.telemetry) == 4
        client.close()
    assert (client.answers, client.lost, client.command) == (2, 2, (0.6, 0.5))
    assert [record.levelname for record in caplog.records if "silently ignore" in record.message] == ["WARNING"]


def test_numbers_are_read_as_the_real_one_reads_them() -> None:
    assert parse_steer({"steering_angle": "1.5e-05", "throttle": " -.5"}) == (1.5e-05, -0.5)
    assert parse_steer({"steering_angle": "0,25", "throttle": "-7"}) == (1.0, -1.0)


def test_a_silent_server_is_told_of(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr("pilot.simulator.wire.client.SILENCE_SECONDS", 0.1)
    with serving(lambda _: None) as server, pytest.raises(TimeoutError, match="no answer"):
        client_of(server, patience=0.4).run()
    assert sum("has not answered" in record.message for record in caplog.records) == 1


# Driving


def path(answer: Answer, **options: object) -> tuple[list[CarState], Client]:
    states: list[CarState] = []
    with serving(answer) as server:
        client = client_of(server, on_tick=states.append, **options)
        client.run()
    return states, client


def test_drives_around_a_circle_and_stops_after_a_lap() -> None:
    _, client = path(expert, laps=1)
    summary = client.summary
    assert 1 <= summary.scores.laps < 1.002
    assert summary.scores.cross_track_max < 0.1
    assert (summary.departures, summary.scores.interventions, summary.lost, summary.reconnects) == (0, 0, 0, 0)
    assert summary.scores.speed * 0.44704 * summary.scores.seconds == pytest.approx(2 * math.pi * RADIUS, rel=0.01)
    assert math.ceil(summary.scores.seconds / 0.04 - 1e-6) == summary.answers
    assert summary.wall_seconds < summary.scores.seconds
    assert "1.00 laps" in str(summary)


def test_as_fast_as_it_goes_the_path_is_always_the_same() -> None:
    def by_telemetry(telemetry: dict[str, str]) -> str:
        time.sleep(0.001 * np.random.default_rng().random())
        return steer(f"{EXPERT + 0.05 * math.sin(float(telemetry['speed'])):.6f}")

    first, second = (path(by_telemetry, seconds=4)[0] for _ in range(2))
    assert len(first) == 200
    assert first == second


def test_ends_at_the_tick() -> None:
    assert len(path(expert, seconds=0.1)[0]) == 5


def test_real_time_is_by_the_clock() -> None:
    began = time.monotonic()
    states, client = path(expert, realtime=True, seconds=0.6)
    assert len(states) == 30
    assert 0.5 < client.summary.wall_seconds < 0.8
    assert time.monotonic() - began < 1.5


def test_time_begins_with_the_first_answer() -> None:
    with serving(lambda _: None) as server:
        client = client_of(server, realtime=True)
        until(lambda: len(server.telemetry) == 2, client)
        client.advance(0.3)
        assert client.episode.ticks == 0
        server.send(steer("0"))
        until(lambda: client.answers, client)
        before = client.episode.ticks
        client.advance(0.1)
        assert client.episode.ticks == before + 5
        client.advance(60.0)  # a window that hung
        assert client.episode.ticks < before + 5 + 20
        client.close()


def test_somebody_at_the_keyboard_drives_instead() -> None:
    with serving(lambda data: expert(data) if data else '42["manual",{}]') as server:
        client = client_of(server, realtime=True)
        until(lambda: client.answers, client)
        client.manual = lambda: (-0.5, 1.0)
        until(lambda: None in server.telemetry, client)
        client.advance(0.1)
        assert (client.episode.state.steering, client.episode.state.throttle) == (-0.5, 1.0)
        client.manual = None
        client.advance(0.1)
        assert client.episode.state.steering == pytest.approx(EXPERT, abs=1e-6)
        client.close()


def right(_telemetry: dict[str, str]) -> str:
    return steer("0.9", "0.3")


def straight(_telemetry: dict[str, str]) -> str:
    return steer("0", "1")


def test_off_the_road_it_is_put_back_after_two_seconds() -> None:
    states, client = path(right, seconds=20)
    assert client.summary.scores.interventions >= 1
    assert client.summary.departures >= client.summary.scores.interventions
    off, longest = 0, 0
    for state in states:
        off = 0 if state.on_road else off + 1
        longest = max(off, longest)
    assert longest == 101


def test_far_off_the_road_it_is_put_back_at_once() -> None:
    episode = Episode(circle())
    episode.place(0, heading_error=-math.pi / 2, speed=25)
    states, client = path(straight, episode=episode, seconds=2)
    assert client.summary.scores.interventions == client.summary.departures == 1
    assert 11.5 < client.summary.scores.cross_track_max < 12.3
    assert states[-1].on_road


def test_put_back_may_be_left_out() -> None:
    _, client = path(right, seconds=20, put_back=False)
    assert client.summary.departures >= 1
    assert client.summary.scores.interventions == 0


# A server that comes and goes


def test_keeps_its_last_command_and_connects_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("pilot.simulator.wire.connection.RETRY_SECONDS", 0.1)
    caplog.set_level(logging.INFO, "pilot")
    port = free_port()
    client = Client(Episode(circle()), lambda _: FRAME, port=port)
    for _ in range(30):  # more than one attempt
        client.advance(0.01)
        time.sleep(0.01)
    assert client.episode.ticks == 0
    with serving(expert, port):
        until(lambda: client.answers > 5, client)
    ticks, answers = client.episode.ticks, client.answers
    for _ in range(30):
        client.advance(0.01)
        time.sleep(0.01)
    assert client.answers <= answers + 2
    assert client.episode.ticks >= ticks + 13
    assert client.episode.state.steering == pytest.approx(EXPERT, abs=1e-6)
    with serving(lambda _: steer("0.01"), port) as server:
        until(lambda: client.episode.state.steering == 0.01 and len(server.telemetry) >= 2, client)
        client.close()
    assert client.summary.reconnects == 1
    assert [" ".join(record.message.split()[:3]) for record in caplog.records] == [
        "no server at",
        "connected to the",
        "connection lost (the",
        "connected to the",
    ]


def test_as_fast_as_it_goes_time_stands_still_without_a_server() -> None:
    port = free_port()
    client = Client(Episode(circle()), lambda _: FRAME, port=port, realtime=False)
    with serving(expert, port):
        while not client.step(1) or client.answers < 10:
            pass
    while client.step(0.1):
        pass
    ticks = client.episode.ticks
    for _ in range(3):
        client.step(0.1)
    assert client.episode.ticks == ticks
    with serving(expert, port):
        deadline = time.monotonic() + 5
        while not client.step(0.1):
            assert time.monotonic() < deadline
        client.close()
    assert client.episode.ticks == ticks + 2


def test_ctrl_c_takes_leave() -> None:
    def answer(telemetry: dict[str, str]) -> str:
        if len(server.telemetry) == 5:
            os.kill(os.getpid(), signal.SIGINT)
        return expert(telemetry)

    with serving(answer) as server:
        client = client_of(server, laps=1)
        with pytest.raises(KeyboardInterrupt):
            client.run()
        server.join(0.1)
    assert 3 <= client.summary.answers <= 6
    assert server.packets[-3:] == ["41", "1", "close"]


DRIVE_SERVER = """
import logging, sys
from pilot.driving.autopilot import Autopilot
from pilot.driving.controller import ControllerConfig
from pilot.driving.server import DriveServer
from pilot.driving.connections import listen
logging.basicConfig(stream=sys.stdout)
logging.getLogger("pilot").setLevel(logging.INFO)
from pilot import cli
server = DriveServer(Autopilot(lambda frame: float(sys.argv[2]), ControllerConfig()))
sys.exit(cli.run("server", lambda: server.serve(listen("127.0.0.1", int(sys.argv[1])))))
"""


def test_drives_by_the_project_s_own_server() -> None:
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVE_SERVER, str(port), str(EXPERT)], cwd=REPOSITORY, stdout=subprocess.PIPE, text=True
    )
    try:
        episode = Episode(circle())
        referee = Referee(episode, seconds=4)
        client = Client(episode, lambda _: FRAME, port=port, realtime=False, referee=referee, patience=20)
        summary = client.run()
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=10)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "simulator disconnected" in said
    assert "ERROR" not in said
    assert (summary.answers, summary.lost) == (100, 0)
    assert summary.scores.speed > 1
    assert summary.scores.cross_track_max < 0.1
