"""The data page in a real browser, served by inspect_data.py."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import needs_browser, opened_browser
from conftest import REPOSITORY, write_recording
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait
from wire import free_port

from pilot.data.driving_log import read_driving_logs
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, save_model

pytestmark = needs_browser
PATIENCE = 60.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    write_recording(folder / "laps", moments=60)
    write_recording(folder / "more", moments=30, cameras=("center",), line=lambda m: f"IMG/{name(m)},,,0.1,0.5,0,20")
    save_model(folder / "model.pt", Model("lenet", build_network("lenet", 1), {}, {}, {}))
    return folder


def name(moment: int) -> str:
    from conftest import stamp

    return f"center_{stamp(moment)}.jpg"


@pytest.fixture(scope="module")
def browser(folder: Path) -> Iterator[webdriver.Chrome]:
    port = free_port()
    options = ("--model", str(folder / "model.pt"), "--port", str(port), "--no-browser", "--no-networks")
    command = [sys.executable, "-u", str(REPOSITORY / "inspect_data.py"), str(folder), *options]
    with (folder / "inspect.log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as process:
        try:
            deadline = time.monotonic() + PATIENCE
            while "Ctrl-C ends" not in (folder / "inspect.log").read_text():
                assert process.poll() is None, (folder / "inspect.log").read_text()
                assert time.monotonic() < deadline
                time.sleep(0.1)
            with opened_browser() as browser:
                browser.get(f"http://127.0.0.1:{port}/")
                yield browser
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 130
    assert "Traceback" not in (folder / "inspect.log").read_text()


def wait_for(browser: webdriver.Chrome, condition: str) -> None:
    WebDriverWait(browser, PATIENCE, 0.1).until(lambda _: browser.execute_script(f"return {condition}"))


def press(browser: webdriver.Chrome, key: str) -> None:
    browser.execute_script(f"dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")


def test_shows_recordings_and_rows(browser: webdriver.Chrome) -> None:
    wait_for(browser, "data !== null && !byId('state').textContent && data.predicted !== null")
    names = [row.text.split()[0] for row in browser.find_elements(By.CSS_SELECTOR, "#recordings tr")]
    assert names == ["laps", "more"]
    wait_for(browser, "byId('center').naturalWidth === 640 && byId('left').naturalWidth === 320")
    for _ in range(3):
        press(browser, "ArrowRight")
    assert re.match(r"row 3 of 60, 0\.3 s: steering 0\.\d+, model", browser.find_element(By.ID, "values").text)
    press(browser, " ")
    wait_for(browser, "row > 8")
    press(browser, " ")


def test_a_range_is_left_out_and_restored(browser: webdriver.Chrome, folder: Path) -> None:
    browser.execute_script("go(20)")
    press(browser, "[")
    browser.execute_script("go(29)")
    press(browser, "]")
    press(browser, "x")
    wait_for(browser, "data.left_out.filter((out) => out).length === 10")
    assert read_driving_logs([folder / "laps"]).left_out[0] == {"left out by hand": 10}
    wait_for(browser, "byId('recordings').textContent.includes('left out by hand: 10')")
    browser.execute_script("go(25)")
    browser.find_element(By.ID, "restore").click()
    wait_for(browser, "!data.left_out.includes(true)")
    assert len(read_driving_logs([folder / "laps"]).rows) == 60


def test_a_recording_without_side_cameras(browser: webdriver.Chrome) -> None:
    browser.find_elements(By.CSS_SELECTOR, "#recordings tr")[1].click()
    wait_for(browser, "data.time.length === 30 && byId('center').src.includes('recordings/1/')")
    assert not browser.find_element(By.ID, "left").is_displayed()


def test_fits_a_narrow_screen_without_errors(browser: webdriver.Chrome) -> None:
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
    )
    wait_for(browser, "innerWidth === 390")
    assert browser.execute_script("return document.documentElement.scrollWidth") == 390
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
