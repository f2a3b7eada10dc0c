"""Draws the README's pictures of a drive.

    python docs/pictures.py model.pt

A made-up road is seen through the simulator's camera, and driven through drive.py on the real wire;
the page is photographed in headless Chromium, and a clip is made of the recorded drive.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import av
import cv2
import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from wire import WireClient, jpeg, telemetry

from pilot import camera
from pilot.frames import Frame

PORT = 4588
HALF_WIDTH = 4.2  # metres of the made-up road
STEP = 0.05  # seconds between two frames
SPEED = 9.0  # m/s


def curvature_at(distance: float) -> float:
    """The road's curvature (1/m) along it."""
    return float(0.012 * np.sin(distance / 25) + 0.008 * np.sin(distance / 11))


def road_frame(distance: float, offset: float, heading: float, rng: np.random.Generator) -> Frame:
    """What a car sees that stands `offset` metres right of the middle, turned `heading` radians to the right."""
    rows, columns = np.mgrid[0:160, 0:320]
    pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    x, z, w = np.linalg.inv(camera.ground_to_pixel()) @ pixels
    on_ground = w > 1e-3
    x, z = x / np.where(on_ground, w, 1), z / np.where(on_ground, w, 1)
    aside = x + offset + heading * z - curvature_at(distance + 8) * z**2 / 2
    stripe = (np.abs(aside) < 0.1) & ((z + distance) % 6 < 3)
    edge = (np.abs(aside) > HALF_WIDTH - 0.25) & (np.abs(aside) < HALF_WIDTH)
    colors = np.where((np.abs(aside) < HALF_WIDTH)[:, None], (118, 116, 112), (104, 128, 70)).astype(float)
    colors[edge], colors[stripe] = (215, 190, 60), (225, 225, 225)
    near = np.clip(1 - z / 60, 0, 1)[:, None]
    colors += rng.normal(0, 7, (len(z), 1)) * near
    haze = np.array((170, 195, 220))
    colors = np.where(on_ground[:, None] & (z > 0)[:, None], colors * near + haze * 0.8 * (1 - near), haze)
    return colors.reshape(160, 320, 3).clip(0, 255).astype(np.uint8)


def drive(client: WireClient, seconds: float) -> None:
    """Drive the made-up road in real time; the model steers."""
    rng = np.random.default_rng(0)
    distance, offset, heading = 0.0, 0.4, 0.0
    for _ in range(int(seconds / STEP)):
        began = time.perf_counter()
        image = jpeg(road_frame(distance, offset, heading, rng))
        client.event("telemetry", telemetry(image, speed=f"{SPEED * 2.237:.4f}"))
        _, command = client.answer()
        turn = camera.steering_to_curvature(float(command["steering_angle"])) - curvature_at(distance)
        heading += turn * SPEED * STEP
        offset += heading * SPEED * STEP
        distance += SPEED * STEP
        time.sleep(max(STEP - (time.perf_counter() - began), 0))


def photograph(target: Path, client: WireClient) -> None:
    """The page, after some seconds of driving."""
    options = webdriver.ChromeOptions()
    for option in ("--headless", "--no-sandbox", "--disable-gpu", "--window-size=1060,900"):
        options.add_argument(option)
    browser = webdriver.Chrome(options, Service(shutil.which("chromedriver")))
    browser.get(f"http://127.0.0.1:{PORT}/")
    drive(client, 20)
    browser.find_element(By.ID, "saliency").click()
    drive(client, 5)
    browser.save_screenshot(str(target))
    browser.quit()


def main(model: Path) -> None:
    """Drive, photograph, make the clip, take a frame of it."""
    with tempfile.TemporaryDirectory() as name:
        run = Path(name) / "run1"
        command = [sys.executable, str(ROOT / "drive.py"), str(model), str(run), "--port", str(PORT)]
        server = subprocess.Popen(command)
        time.sleep(8)
        with WireClient(PORT) as client:
            client.connect()
            photograph(ROOT / "docs" / "page.png", client)
        server.terminate()
        server.wait()
        clip = Path(name) / "clip.mp4"
        overlays = ["--wheel", "--speed", "--path", "--saliency", str(model)]
        subprocess.run([sys.executable, str(ROOT / "video.py"), str(run), "--out", str(clip), *overlays], check=True)
        with av.open(str(clip)) as container:
            frames = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
        cv2.imwrite(str(ROOT / "docs" / "clip.png"), frames[len(frames) // 3])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
