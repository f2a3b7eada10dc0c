"""Pages of other origins, in a real browser, that try to take the car, to set its speed and to show its page."""

import contextlib
import json
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator

import pytest
from browser import needs_browser, opened_browser
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait
from server_attacks import MESSAGE
from serving import Server
from wire import free_port

pytestmark = needs_browser

PAGE = """<!doctype html><title>other</title>
<iframe name="shown" src="http://127.0.0.1:PORT/"></iframe>
<iframe name="answer"></iframe>
<form action="http://127.0.0.1:PORT/speed" method="post" enctype="text/plain" target="answer">
  <input name='{"mph": 3, "x": "' value='"}'></form>
<script>
const server = "http://127.0.0.1:PORT", results = {};
const note = name => [() => { results[name] = "succeeded"; }, () => { results[name] = "failed"; }];
const post = (mph, more) => fetch(server + "/speed", {method: "POST", body: JSON.stringify({mph}), ...more});
const socket = new WebSocket("ws://127.0.0.1:PORT/socket.io/?EIO=4&transport=websocket");
const [taken, refused] = note("car");
socket.onopen = () => { socket.send(MESSAGE); taken(); };
socket.onerror = refused;
post(1, {headers: {"Content-Type": "application/json"}}).then(...note("speed"));
post(2, {mode: "no-cors"}).then(...note("blind speed"));
fetch(server + "/socket.io/?EIO=4&transport=polling").then(...note("polling"));
const events = new EventSource(server + "/events");
[events.onmessage, events.onerror] = note("events");
const script = document.createElement("script");
[script.onload, script.onerror] = note("script");
script.src = server + "/static/page.js";
document.head.append(script);
document.forms[0].submit();
</script>"""
TRIES = ("car", "speed", "polling", "events", "script")
BLIND = "blind speed"  # a page never learns what became of it; the speed shows it


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    server = Server(tmp_path_factory.mktemp("drive"))
    yield server
    assert server.stop() == 130


@pytest.fixture(scope="module")
def other(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The port of a web server with the hostile page."""
    folder = tmp_path_factory.mktemp("site")
    page = PAGE.replace("PORT", str(server.port)).replace("MESSAGE", json.dumps(MESSAGE))
    (folder / "index.html").write_text(page)
    port = free_port()
    # in a process of its own: this one may have imported eventlet, which leaves a changed http.server behind
    command = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1", "--directory", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as site:
        wait_for_port(port)
        yield port
        site.kill()


def wait_for_port(port: int, seconds: float = 30) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.05)
    pytest.fail(f"nothing listens on port {port}")


@pytest.fixture(scope="module")
def browser() -> Iterator[webdriver.Chrome]:
    with opened_browser("--host-resolver-rules=MAP evil.example 127.0.0.1") as browser:
        yield browser


def set_speed(server: Server) -> float:
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/events", timeout=10) as reply:
        return float(json.loads(reply.readline().removeprefix(b"data: "))["set_speed"])


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "evil.example"])
def test_a_page_of_another_origin_gets_nothing(
    server: Server, other: int, browser: webdriver.Chrome, host: str
) -> None:
    browser.get(f"http://{host}:{other}/")
    expected = dict.fromkeys(TRIES, "failed")
    WebDriverWait(browser, 15).until(lambda _: len(browser.execute_script("return results")) > len(TRIES))
    results = browser.execute_script("return results")
    assert {name: results[name] for name in TRIES} == expected
    browser.switch_to.frame("shown")
    assert browser.find_elements(By.ID, "set-speed") == []
    assert set_speed(server) == 20
    with server.client() as car:
        car.send(MESSAGE)
        assert car.answer()[0] == "steer"  # no other car is driven


def test_a_name_that_is_made_to_mean_this_computer_shows_no_page(server: Server, browser: webdriver.Chrome) -> None:
    browser.get(f"http://evil.example:{server.port}/")
    assert "is not a name of this server" in browser.find_element(By.TAG_NAME, "body").text
    browser.get(f"http://127.0.0.1:{server.port}/")
    assert browser.find_elements(By.ID, "set-speed")
