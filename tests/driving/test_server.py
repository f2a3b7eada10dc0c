"""drive.py as the simulator meets it: the real command, and raw frames on the wire."""

import base64
import json
import re
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import REPOSITORY
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from serving import IMAGE, MESSAGE, Server, driven, post, steers
from wire import WireClient, drive, free_port, telemetry

from pilot.data.driving_log import read_driving_logs


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    server = Server(tmp_path_factory.mktemp("drive"))
    yield server
    assert "Traceback" not in server.text()
    assert server.stop() == 130


def test_greets_as_the_transcript_has_it_and_waits_for_the_car(server: Server) -> None:
    with server.client() as client:
        client.socket.settimeout(0.5)
        with pytest.raises(TimeoutError):  # no steer before the first telemetry
            client.receive()


def test_drives_without_a_stall(server: Server) -> None:
    with server.free_client() as client:
        assert len(drive(client, MESSAGE, 2000)) == 2000


def test_the_server_is_pinged(server: Server) -> None:
    with server.free_client() as client:
        client.send("2")
        assert client.receive() == "3"


def test_steering_and_throttle_are_strings_in_range(server: Server) -> None:
    with server.free_client() as client:
        name, argument = steers(client, telemetry(IMAGE))
        assert name == "steer"
        assert set(argument) == {"steering_angle", "throttle"}
        assert all(isinstance(text, str) and re.fullmatch(r"-?\d\.\d+", text) for text in argument.values())
        assert all(-1 <= float(text) <= 1 for text in argument.values())


def test_decimal_commas_in_decimal_commas_out(server: Server) -> None:
    with server.free_client() as client:
        _, argument = steers(client, telemetry(IMAGE, speed="12,5"))
        assert all(re.fullmatch(r"-?\d,\d+", text) for text in argument.values())


def test_manual_driving_is_answered_with_manual(server: Server) -> None:
    with server.free_client() as client:
        assert steers(client, None) == ("manual", {})
        assert steers(client, telemetry(IMAGE))[0] == "steer"


@pytest.mark.parametrize(
    "change",
    [
        {"image": "%%"},
        {"image": None},
        {"image": base64.b64encode(IMAGE[:3000]).decode()},
        {"speed": "nan"},
        {"speed": "1e9"},
        {"speed": {}},
        {"steering_angle": "x"},
    ],
)
def test_a_bad_telemetry_gets_the_last_command(server: Server, change: dict[str, object]) -> None:
    with server.free_client() as client:
        good = steers(client, telemetry(IMAGE, speed="3"))
        assert steers(client, {**telemetry(IMAGE), **change}) == good
        assert steers(client, telemetry(IMAGE))[0] == "steer"


def test_unknown_events_get_the_last_command_and_a_warning(server: Server) -> None:
    with server.free_client() as client:
        good = steers(client, telemetry(IMAGE))
        client.event("fly", {"height": 3})
        assert client.answer() == good
    server.wait_for("unknown packet", 5)


def test_a_silent_connection_is_revived(server: Server) -> None:
    with server.free_client() as client:
        good = steers(client, telemetry(IMAGE))
        began = time.monotonic()
        assert client.answer() == good
        assert 0.8 < time.monotonic() - began < 2.5
    server.wait_for("sending the last command again", 5)


def test_a_second_car_is_told_to_wait_and_drives_when_the_first_is_gone(server: Server) -> None:
    with server.free_client() as first, server.client() as second:
        assert steers(first, telemetry(IMAGE))[0] == "steer"
        assert steers(second, telemetry(IMAGE)) == ("manual", {})
        assert steers(first, telemetry(IMAGE))[0] == "steer"
        server.wait_for("one car at a time is driven", 5)
        first.send("41")
        first.send("1")
        first.socket.close()
        assert driven(second)[0] == "steer"


def test_a_taken_port_is_an_error_with_the_cure(server: Server) -> None:
    command = [sys.executable, str(REPOSITORY / "drive.py"), "model.pt", "--port", str(server.port)]
    second = subprocess.run(command, cwd=server.folder, capture_output=True, text=True, timeout=60)
    assert second.returncode == 1
    assert f"cannot listen on 127.0.0.1:{server.port}" in second.stderr
    assert "another drive.py" in second.stderr


def test_a_connection_that_breaks_off_in_a_message_harms_nobody(server: Server) -> None:
    broken = server.client()
    broken.frame(MESSAGE[:500].encode(), 1, final=False)
    broken.socket.close()
    with server.free_client() as client:
        assert steers(client, telemetry(IMAGE))[0] == "steer"


def test_a_drive_is_recorded_and_makes_a_clip(tmp_path: Path) -> None:
    server = Server(tmp_path, "run1", "--speed", "15")
    with server.client() as client:
        drive(client, MESSAGE, 40)
    assert server.stop() == 130
    assert "python video.py run1" in server.text()
    rows = read_driving_logs([tmp_path / "run1"]).rows
    assert 30 <= len(rows) <= 42  # frames within one millisecond share a name
    assert rows["speed"].iloc[0] == pytest.approx(12.3456)
    clip = subprocess.run([sys.executable, str(REPOSITORY / "video.py"), "run1"], cwd=tmp_path, timeout=60)
    assert clip.returncode == 0
    assert (tmp_path / "run1.mp4").stat().st_size > 1000
    command = [sys.executable, str(REPOSITORY / "drive.py"), "model.pt", "run1", "--port", str(free_port())]
    again = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert again.returncode == 1
    assert "add --overwrite" in again.stderr
    assert len(read_driving_logs([tmp_path / "run1"]).rows) == len(rows)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["absent.pt"], "absent.pt: no such file"), (["text.pt"], "damaged"), (["model.pt", "--speed", "99"], "99: must")],
)
def test_what_cannot_drive_is_refused(server: Server, arguments: list[str], says: str) -> None:
    (server.folder / "text.pt").write_text("no model")
    result = subprocess.run(
        [sys.executable, str(REPOSITORY / "drive.py"), *arguments],
        cwd=server.folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 1
    assert says in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.filterwarnings("ignore")  # eventlet says at its import that it is in maintenance only
def test_other_package_versions_are_refused_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    from pilot.driving import server

    server.check_versions()
    monkeypatch.setattr(server.metadata, "version", {"python-socketio": "4.6.1", "python-engineio": "3.14.2"}.get)
    cure = "python-engineio 3.14.2: .* pip install .*python-engineio==3.13.2"
    with pytest.raises(server.WrongVersionError, match=cure):
        server.check_versions()


# Hostile messages

IMAGES = st.one_of(
    st.binary(max_size=300).map(lambda data: base64.b64encode(data).decode()),
    st.text(max_size=50),
    st.integers(0, len(IMAGE)).map(lambda size: base64.b64encode(IMAGE[:size]).decode()),
)
NUMBERS = st.one_of(
    st.sampled_from(["nan", "inf", "-inf", "1e999", "", "12,5", "0x10", "٣"]),
    st.floats().map(str),
    st.none(),
    st.booleans(),
    st.integers(),
    st.lists(st.integers(), max_size=3),
    st.text(max_size=10),
)
FIELDS = {"image": IMAGES, "speed": NUMBERS, "steering_angle": NUMBERS, "throttle": NUMBERS}
TELEMETRY = st.fixed_dictionaries({}, optional=FIELDS)
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
)
ODD = [
    "",
    "0",
    "3",
    "4",
    "5",
    "6",
    "7",
    "40",
    "40/other",
    "42",
    "42[",
    "43",
    "44",
    '451-["telemetry",{}]',
    '451-["telemetry",{"_placeholder":true,"num":0}]',
    '42["telemetry",{"speed":]',
    '42["telemetry"]',
    '42["connect",{}]',
    '42["disconnect"]',
    '42/x,["telemetry",{}]',
    '421["x"]',
]
PACKETS = st.one_of(
    TELEMETRY.map(lambda data: "42" + json.dumps(["telemetry", data])),
    JSON.map(lambda data: "42" + json.dumps(["telemetry", data])),
    JSON.map(lambda data: "42" + json.dumps(data)),
    st.text(max_size=40).filter(lambda text: text not in ("1", "41")),  # with these the client takes its leave
    st.sampled_from(ODD),
)
MESSAGES = st.one_of(
    PACKETS.map(lambda text: (1, text.encode("utf-8", "replace"))),
    st.binary(max_size=40).map(lambda data: (2, data)),
    st.just((2, b"x" * 70_000)),
    st.just((9, b"ping")),
)


@pytest.mark.filterwarnings("ignore::hypothesis.errors.HypothesisWarning")  # a large message to print
@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck), phases=[Phase.generate])
@given(messages=st.lists(MESSAGES, min_size=30, max_size=70))
def test_after_any_messages_the_next_good_telemetry_is_answered(
    server: Server, messages: list[tuple[int, bytes]]
) -> None:
    with server.client() as client:
        for opcode, payload in messages:
            client.frame(payload, opcode)
        client.event("telemetry", None)  # a mark: everything before it has been handled when it is answered
        while client.answer() != ("manual", {}):
            pass
        name, argument = driven(client)
        assert name == "steer"
        assert all(-1 <= float(text.replace(",", ".")) <= 1 for text in argument.values())


def test_memory_stays_flat_under_hostile_messages(server: Server) -> None:
    with server.free_client() as client:
        drive(client, MESSAGE, 200)
    before = server.memory()
    bad = "42" + json.dumps(["telemetry", {**telemetry(IMAGE), "speed": "nan"}])
    for _ in range(30):
        with server.free_client() as client:
            drive(client, bad, 20)
            client.frame(b"x" * 500_000, 2)
    assert server.memory() - before < 20_000


def test_a_message_without_end_is_cut_off(server: Server) -> None:
    with server.free_client() as client, pytest.raises((ConnectionError, TimeoutError)):
        send_without_end(client)
    with server.client() as next_client:
        assert steers(next_client, telemetry(IMAGE))[0] == "steer"


def send_without_end(client: WireClient) -> None:
    for number in range(100):
        client.frame(b"x" * 100_000, 0 if number else 1, final=False)
    client.receive()


# The page


def get(server: Server, path: str) -> bytes:
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}{path}", timeout=10) as reply:
        return reply.read()


def test_the_page_and_its_events(server: Server) -> None:
    assert b"<title>Drive</title>" in get(server, "/")
    assert b"EventSource" in get(server, "/static/page.js")
    with server.free_client() as client:
        drive(client, MESSAGE, 50)
        reply = urllib.request.urlopen(f"http://127.0.0.1:{server.port}/events?saliency=1", timeout=10)
        shown = json.loads(reply.readline().removeprefix(b"data: "))
        reply.close()
    assert shown["state"] == "driving"
    assert shown["frames_per_second"] > 5
    assert shown["speed"] == pytest.approx(12.35)
    assert base64.b64decode(shown["frame"]).startswith(b"\xff\xd8")
    assert shown["samples"]


def throttles(client: WireClient, *, speed: str, sign: int) -> None:
    """Drive at a speed until the throttle has a sign; the first answers may be repetitions of the one before."""
    for _ in range(10):
        if sign * float(steers(client, telemetry(IMAGE, speed=speed))[1]["throttle"]) > 0:
            return
    pytest.fail(f"the throttle at {speed} mph never had the sign {sign}")


def test_the_set_speed_is_changed_on_the_page(server: Server) -> None:
    def post(body: bytes, kind: str = "application/json") -> int:
        request = urllib.request.Request(f"http://127.0.0.1:{server.port}/speed", body, {"Content-Type": kind})
        try:
            return urllib.request.urlopen(request, timeout=10).status
        except urllib.error.HTTPError as error:
            return error.code

    with server.free_client() as client:
        assert post(b'{"mph": 0}') == 200
        throttles(client, speed="20", sign=-1)
        assert post(b'{"mph": 30}') == 200
        throttles(client, speed="5", sign=1)
    assert [post(b'{"mph": 31}'), post(b'{"mph": "x"}'), post(b"nonsense")] == [400] * 3
    assert post(b'{"mph": 9}', "text/plain") == 400
    odd = [b'{"mph": true}', b'{"mph": NaN}', b'{"mph": 1e999}', b'[{"mph": 9}]', b'"mph"', b"9", b"[" * 1000, b"\xff"]
    assert [post(body) for body in odd] == [400] * len(odd)
    assert post(b'{"mph": 20}') == 200


def test_what_is_posted_to_the_page_is_checked(server: Server) -> None:
    def status(path: str, **body: object) -> int:
        try:
            post(server.port, path, body)
            return 200
        except urllib.error.HTTPError as error:
            message = json.load(error)["error"]
            return error.code if message else 0

    odd = (
        {"steering": 1.1},
        {"steering": "0"},
        {"steering": True},
        {"steering": 0, "throttle": 2},
        {},
        {"throttle": 0},
    )
    assert [status("/wheel", **body) for body in odd] == [400] * len(odd)
    outside = ("../model.pt", "/etc/passwd", "drive.log", "", "model.pt\0", None)
    assert [status("/model", name=name) for name in outside] == [400] * len(outside)
    (server.folder / "damaged.pt").write_bytes(b"no model")
    assert status("/model", name="damaged.pt") == 400
    assert status("/model", name="model.pt") == 200
    assert [status("/recording", on=value) for value in ("yes", 1, None)] == [400] * 3
    with server.free_client() as client:  # and the car drives on
        assert steers(client, telemetry(IMAGE))[0] == "steer"
