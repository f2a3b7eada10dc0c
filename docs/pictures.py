"""Draws the README's pictures of the built-in simulator and of a drive in it.

    python docs/pictures.py model.pt

The cameras' pictures of every track on one sheet; the two real roads from above; the page, photographed in
headless Chromium while drive.py drives the lake; a frame of a clip of that drive; the data page; the table of the
board in docs/board; and the board's page in the folder board/, if docs/board.md's command has been run.
"""

import contextlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import matplotlib.pyplot as plt
import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from pilot.arrays import Frame
from pilot.simulator.catalogue import load_course
from pilot.simulator.simulator import Simulator
from pilot.vehicle import CAMERAS

PORT = "4588"
SHEET = {
    "lake": (0.03, 0.76, 0.64, 0.3),
    "jungle": (0.02, 0.25, 0.55, 0.69),
    "mountain": (0.05, 0.3, 0.55, 0.9),
    "random:3": (0.1, 0.5),
    "random:12": (0.1, 0.5),
}
"""Places, as shares of the lap; of the first of each track all three cameras are shown."""


def draw_sheet(target: Path) -> None:
    """One row a track: left, centre and right camera at a place, and the centre camera at others."""
    rows = []
    with Simulator(CAMERAS) as simulator:
        for track, places in SHEET.items():
            simulator.reset(track)
            frames = [_seen(simulator, place) for place in places]
            first = [frames[0][camera] for camera in ("left", "center", "right")]
            rows.append(first + [frame["center"] for frame in frames[1:]])
    named = [np.hstack(row) for row in (*rows[:3], rows[3][:3] + rows[4][:3])]
    cv2.imwrite(str(target), np.vstack(named)[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])


def draw_real_roads(target: Path) -> None:
    """The lines of lake and jungle from above, with their heights."""
    figure, axes = plt.subplots(1, 2, figsize=(13, 6))
    for ax, name in zip(axes, ("lake", "jungle"), strict=True):
        course = load_course(name)
        track, bridge = course.track, course.track.points[course.on_bridge()]
        points = track.points[np.argsort(track.points[:, 2], kind="stable")]
        heights = ax.scatter(points[:, 0], points[:, 1], c=points[:, 2], s=14)
        ax.plot(*track.points[0, :2], "r^" if name == "lake" else "r>", markersize=11, label="start")
        ax.plot(bridge[:, 0], bridge[:, 1], "r.", markersize=2, label="bridge")
        ax.set(title=f"{name}: {track.length:.0f} m", xlabel="x, m", ylabel="y, m", aspect="equal")
        ax.legend(loc="upper left")
        if name == "jungle":
            figure.colorbar(heights, ax=ax, label="height, m")
    figure.tight_layout()
    figure.savefig(target, dpi=80)


def _seen(simulator: Simulator, place: float) -> dict[str, Frame]:
    simulator.episode.place(place * simulator.episode.track.length)
    return simulator.look()


@contextlib.contextmanager
def driving(model: Path, run: Path) -> Iterator[None]:
    """drive.py drives the lake in the built-in simulator, and records it."""
    commands = (
        ["drive.py", str(model.resolve()), run.name, "--port", PORT],
        ["simulator.py", "connect", "--track", "lake", "--headless", "--port", PORT],
    )
    processes = [
        subprocess.Popen([sys.executable, str(ROOT / script), *rest], cwd=run.parent) for script, *rest in commands
    ]
    try:
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait()


@contextlib.contextmanager
def opened_browser(size: tuple[int, int]) -> Iterator[webdriver.Chrome]:
    """A browser without a window, whose pages have a size in pixels."""
    options = webdriver.ChromeOptions()
    for option in ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(option)
    browser = webdriver.Chrome(options, Service(shutil.which("chromedriver")))
    try:
        resize(browser, size)
        yield browser
    finally:
        browser.quit()


def resize(browser: webdriver.Chrome, size: tuple[int, int]) -> None:
    """Give the page a size in pixels."""
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def photograph(target: Path, narrow: Path) -> None:
    """The page after half a minute of driving, of which a person steered a second; wide and narrow."""
    with opened_browser((1280, 960)) as browser:
        browser.get(f"http://127.0.0.1:{PORT}/")
        time.sleep(18)
        for event in ("keydown", "keyup"):
            browser.execute_script(f"dispatchEvent(new KeyboardEvent('{event}', {{code: 'ArrowLeft'}}))")
            time.sleep(0.3)
        time.sleep(5)
        browser.find_element(By.ID, "saliency").click()
        time.sleep(5)
        browser.save_screenshot(str(target))
        resize(browser, (390, 1250))
        time.sleep(2)
        browser.save_screenshot(str(narrow))


def photograph_data(model: Path, folder: Path, target: Path) -> None:
    """The data page with a recording of the built-in simulator, in which the picture freezes."""
    record = ["simulator.py", "record", "--track", "lake", "--laps", "0.6", "--line-spread", "0.5", "--wander", "0.4"]
    subprocess.run([sys.executable, str(ROOT / record[0]), *record[1:], "--out", str(folder / "laps")], check=True)
    pictures = sorted((folder / "laps" / "IMG").glob("center_*.jpg"))
    for picture in pictures[301:330]:
        shutil.copy(pictures[300], picture)
    options = ["--model", str(model), "--no-networks", "--no-browser", "--port", PORT]
    command = [sys.executable, str(ROOT / "inspect_data.py"), str(folder), *options]
    with subprocess.Popen(command) as process, opened_browser((1280, 1180)) as browser:
        time.sleep(15)
        browser.get(f"http://127.0.0.1:{PORT}/")
        while browser.execute_script("return !data?.predicted || byId('state').textContent !== ''"):
            time.sleep(1)
        browser.execute_script("nextMoment(1)")
        time.sleep(2)
        browser.save_screenshot(str(target))
        process.send_signal(signal.SIGINT)


def photograph_board(page: Path, size: tuple[int, int], target: Path) -> None:
    """The upper part of a board's page."""
    with opened_browser(size) as browser:
        browser.get(page.as_uri())
        browser.save_screenshot(str(target))


def draw_clip_frame(run: Path, model: Path, target: Path) -> None:
    """A frame of a clip with all overlays."""
    clip = run.with_suffix(".mp4")
    overlays = ["--wheel", "--speed", "--path", "--saliency", str(model)]
    subprocess.run([sys.executable, str(ROOT / "video.py"), str(run), "--out", str(clip), *overlays], check=True)
    with av.open(str(clip)) as container:
        frames = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
    cv2.imwrite(str(target), frames[len(frames) // 2])


def main(model: Path) -> None:
    """Draw them all."""
    draw_sheet(ROOT / "docs" / "tracks.jpg")
    draw_real_roads(ROOT / "docs" / "real_roads.png")
    with tempfile.TemporaryDirectory() as name:
        run = Path(name) / "run1"
        with driving(model, run):
            time.sleep(8)
            photograph(ROOT / "docs" / "page.png", ROOT / "docs" / "page_narrow.png")
        draw_clip_frame(run, model, ROOT / "docs" / "clip.png")
        photograph_data(model, Path(name) / "data", ROOT / "docs" / "data_page.png")
    photograph_board(ROOT / "docs" / "board" / "v1" / "board.html", (1420, 2400), ROOT / "docs" / "board_recipes.png")
    if (board := ROOT / "board" / "board.html").exists():
        photograph_board(board, (1280, 760), ROOT / "docs" / "board.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
