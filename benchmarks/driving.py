"""Latency of the answers to telemetry: in the process, and on the wire, compared with a server like the original one.

    python benchmarks/driving.py [--network nvidia] [--steers 10000] [--against ANOTHER_CHECKOUT]

In the process: from the base64 image to the steering, with several ways to run the network. On the wire: the tests' raw
WebSocket client, which fragments messages like websocket-sharp, with the kernel's delayed packets; it connects to
drive.py and to original_drive.py in turn, without pauses, with one telemetry message at a time, and at 60 rendered
frames per second.
"""

import argparse
import base64
import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import torch
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from wire import WireClient, telemetry

from pilot.data.frames import encode_frame
from pilot.driving.driver import Driver
from pilot.driving.telemetry import parse_telemetry
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, load_model, save_model
from pilot.model.networks import network_names

LONGEST = 60.0  # seconds, maximum duration of one measurement
SCENES = (("no pause", 2, 0.0), ("one telemetry at a time", 1, 0.0), ("60 rendered frames/s", 2, 1 / 60))
SteeringPolicy = Callable[[dict[str, str]], float]


def synthetic_image() -> bytes:
    """Return a synthetic JPEG image that compresses like those of the simulator (about 13 KB)."""
    rng = np.random.default_rng(0)
    coarse = Image.fromarray(rng.integers(60, 200, (20, 40, 3), dtype=np.uint8)).resize((320, 160))
    noise = rng.integers(-9, 10, (160, 320, 1))
    image: bytes = encode_frame((np.asarray(coarse).astype(int) + noise).clip(0, 255).astype(np.uint8))
    return image


def ways(model: Model) -> Iterator[tuple[str, SteeringPolicy]]:
    """Yield name and function of each way from a telemetry message to the steering."""

    def pillow(message: dict[str, str]) -> torch.Tensor:
        image = np.array(Image.open(BytesIO(base64.b64decode(message["image"]))))
        return torch.from_numpy(image[None])

    def cv2(message: dict[str, str]) -> torch.Tensor:
        return torch.from_numpy(parse_telemetry(message).frame[None])

    for threads in (2, 1):
        torch.set_num_threads(threads)
        yield f"eager, Pillow, {threads} threads", lambda message: float(model.network(pillow(message)))
        yield f"eager, OpenCV, {threads} threads", lambda message: float(model.network(cv2(message)))
        compiled = torch.compile(model.network)
        yield f"compiled, {threads} threads", functools.partial(_through, compiled, cv2)
        driver = Driver(model)
        torch.set_num_threads(threads)
        yield f"frozen (drive.py), {threads} threads", functools.partial(_driven, driver)


def _through(
    network: Callable[[torch.Tensor], torch.Tensor],
    decode: Callable[[dict[str, str]], torch.Tensor],
    message: dict[str, str],
) -> float:
    return float(network(decode(message)))


def _driven(driver: Driver, message: dict[str, str]) -> float:
    return driver.steer(parse_telemetry(message).frame)


def in_process(model: Model, message: dict[str, str], repeats: int) -> None:
    """Print the 50th and 99th percentile of the time from a telemetry message to the steering, in each way."""
    with torch.inference_mode():
        for name, steer in ways(model):
            for _ in range(30):
                steer(message)
            seconds = [timed(steer, message) for _ in range(repeats)]
            p50, p99 = percentile(seconds, 50), percentile(seconds, 99)
            print(f"{name:32s} p50 {p50:6.2f} ms, p99 {p99:6.2f} ms", flush=True)


def timed(steer: SteeringPolicy, message: dict[str, str]) -> float:
    """Return the time of one call in seconds."""
    began = time.perf_counter()
    steer(message)
    return time.perf_counter() - began


def percentile(seconds: list[float], share: float) -> float:
    """Return a percentile (0..100) of times in seconds, in milliseconds."""
    return float(np.percentile(seconds, share)) * 1000


@contextmanager
def serving(command: list[str], port: int, folder: Path) -> Iterator[None]:
    """Run a server in its own process; the context begins when it accepts connections."""
    with (folder / "log").open("w") as log:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log, env=environment)
        try:
            deadline = time.monotonic() + 60
            while time.monotonic() < deadline:
                try:
                    WireClient(port).socket.close()
                    break
                except OSError:
                    time.sleep(0.1)
            time.sleep(1)
            yield
        finally:
            process.kill()
            process.wait()


def on_the_wire(port: int, message: str, steers: int, *, in_flight: int, pause: float) -> tuple[list[float], float]:
    """Exchange messages like the simulator, until `steers` answers have arrived or LONGEST has passed.

    Args:
        port: port of the server.
        message: telemetry message.
        steers: number of answers.
        in_flight: number of telemetry messages in flight; the simulator has two.
        pause: seconds after each answer, in which the simulator would render.

    Returns:
        The seconds from sending each telemetry message to receiving its answer, and the answers per second.
    """
    with WireClient(port) as client:
        client.socket.settimeout(20)
        client.send("2")
        began = time.perf_counter()
        sent: list[float] = []
        seconds: list[float] = []
        for _ in range(in_flight):
            client.send(message)
            sent.append(time.perf_counter())
        while len(seconds) < steers and time.perf_counter() - began < LONGEST:
            client.answer()
            seconds.append(time.perf_counter() - sent.pop(0))
            time.sleep(pause)
            client.send(message)
            sent.append(time.perf_counter())
        return seconds, len(seconds) / (time.perf_counter() - began)


def compare(servers: dict[str, list[str]], message: str, folder: Path, options: argparse.Namespace) -> None:
    """Print rate and latency of each server in each scene, measured in turn, and the rates relative to drive.py's."""
    for title, in_flight, pause in SCENES:
        steers = (options.steers if pause == 0 else options.steers // 10) // options.rounds
        rates: dict[str, list[float]] = {server: [] for server in servers}
        for _ in range(options.rounds):
            for server, command in servers.items():
                with serving(command, options.port, folder):
                    seconds, rate = on_the_wire(options.port, message, steers, in_flight=in_flight, pause=pause)
                rates[server].append(rate)
                print(
                    f"{title}, {server}: {len(seconds)} steers, {rate:.0f} answers/s, "
                    f"p50 {percentile(seconds, 50):.2f} ms, p99 {percentile(seconds, 99):.2f} ms",
                    flush=True,
                )
        for server in list(servers)[1:]:
            ratio = np.median(rates["drive.py"]) / np.median(rates[server])
            print(f"{title}: drive.py answers {ratio:.2f} times as often as {server}", flush=True)


def main() -> None:
    """Print all measurements, and the ratios of the servers' rates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--network", default="nvidia", choices=network_names())
    parser.add_argument("--steers", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--port", type=int, default=4599)
    parser.add_argument("--against", type=Path, help="another checkout, measured in turn with this one")
    options = parser.parse_args()
    content = telemetry(synthetic_image())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_model(folder / "model.pt", Model(options.network, build_network(options.network, 0), {}, {}, {}))
        in_process(load_model(folder / "model.pt"), content, 500)
        port = str(options.port)
        servers = {
            "drive.py": [sys.executable, str(ROOT / "drive.py"), "model.pt", "--port", port],
            "original": [sys.executable, str(ROOT / "benchmarks" / "original_drive.py"), "model.pt", port],
        }
        if options.against:
            other = options.against.resolve() / "drive.py"
            servers[f"drive.py of {options.against}"] = [sys.executable, str(other), "model.pt", "--port", port]
        compare(servers, "42" + json.dumps(["telemetry", content]), folder, options)


if __name__ == "__main__":
    main()
