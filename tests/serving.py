"""drive.py in a process of its own, for tests that meet it as the simulator does."""

import json
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from conftest import REPOSITORY, picture
from wire import WireClient, free_port, telemetry

from pilot.data.frames import encode_frame
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, save_model

IMAGE = encode_frame(picture(0.2))
MESSAGE = "42" + json.dumps(["telemetry", telemetry(IMAGE)])


class Server:
    """drive.py in a process of its own."""

    def __init__(self, folder: Path, *arguments: str, open_files: int | None = None) -> None:
        """Start it with a new model; `open_files` limits the files and connections that the process may open."""
        self.folder, self.port = folder, free_port()
        save_model(folder / "model.pt", Model("pilotnet", build_network("pilotnet", 1), {}, {}, {}))
        self.log = (folder / "drive.log").open("w+")
        command = [sys.executable, "-u", str(REPOSITORY / "drive.py"), "model.pt", *arguments, "--port", str(self.port)]
        if open_files is not None:
            command = ["sh", "-c", f'ulimit -n {open_files}; exec "$@"', "sh", *command]
        self.process = subprocess.Popen(command, cwd=folder, stdout=self.log, stderr=subprocess.STDOUT)
        try:
            self.wait_for("is ready")
        except AssertionError:
            self.stop(signal.SIGKILL)
            raise

    def client(self) -> WireClient:
        client = WireClient(self.port)
        client.connect()
        return client

    def free_client(self) -> WireClient:
        """A client that is the car: the one before is gone."""
        client = self.client()
        driven(client)
        return client

    def text(self) -> str:
        return (self.folder / "drive.log").read_text()

    def wait_for(self, words: str, seconds: float = 60) -> None:
        deadline = time.monotonic() + seconds
        while words not in self.text():
            assert self.process.poll() is None or words in self.text(), self.text()
            assert time.monotonic() < deadline, self.text()
            time.sleep(0.02)

    def memory(self) -> int:
        """Resident memory in KB."""
        return int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{self.process.pid}/status").read_text())[1])

    def stop(self, how: int = signal.SIGINT) -> int:
        self.process.send_signal(how)
        code = self.process.wait(10)
        self.log.close()
        return code


def post(port: int, path: str, body: dict[str, object]) -> dict[str, object]:
    """Post JSON to the page's server, and return its answer."""
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}{path}", json.dumps(body).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=10) as answer:
        return json.load(answer)


def steers(client: WireClient, message: dict[str, object] | None) -> tuple[str, dict[str, str]]:
    client.event("telemetry", message)
    return client.answer()


def driven(client: WireClient) -> tuple[str, dict[str, str]]:
    """The answer to a good telemetry, once the server has noticed that the car before is gone."""
    for _ in range(100):
        answer = steers(client, telemetry(IMAGE))
        if answer[0] == "steer":
            break
        time.sleep(0.01)
    return answer
