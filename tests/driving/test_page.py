"""The page in a real browser."""

from collections.abc import Iterator

import pytest
from browser import needs_browser, opened_browser
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait
from serving import IMAGE, Server, driven, steers
from wire import WireClient, telemetry

pytestmark = needs_browser


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    server = Server(tmp_path_factory.mktemp("page"))
    yield server
    assert server.stop() == 130


@pytest.fixture(scope="module")
def browser(server: Server) -> Iterator[webdriver.Chrome]:
    with opened_browser() as browser:
        browser.get(f"http://127.0.0.1:{server.port}/")
        yield browser


def wait_for(
    browser: webdriver.Chrome, condition: str, client: WireClient | None = None, *, manual: bool = False
) -> None:
    """Drive on until a condition holds on the page."""

    def holds(_browser: webdriver.Chrome) -> bool:
        if client:
            steers(client, None if manual else telemetry(IMAGE, speed="17.5"))
        return browser.execute_script(f"return {condition}")

    WebDriverWait(browser, 15, poll_frequency=0.05).until(holds)


def text(browser: webdriver.Chrome, name: str) -> str:
    return browser.find_element(By.ID, name).text


def test_shows_a_drive_from_waiting_to_manual(server: Server, browser: webdriver.Chrome) -> None:
    wait_for(browser, "document.getElementById('state').textContent === 'waiting for the simulator'")
    with server.client() as client:
        driven(client)
        wait_for(browser, "document.getElementById('state').textContent === 'driving'", client)
        wait_for(browser, "document.getElementById('speed').textContent === '17.5'", client)
        wait_for(browser, "document.getElementById('frame').naturalWidth === 320", client)
        assert "frames/s" in text(browser, "rate")
        assert "ms an answer" in text(browser, "rate")
        assert "rotate" in browser.find_element(By.ID, "wheel").get_attribute("style")
        wait_for(browser, "samples.length > 3", client)
        before = browser.execute_script("return document.getElementById('frame').src")
        browser.find_element(By.ID, "saliency").click()
        wait_for(browser, f"![{before!r}, ''].includes(document.getElementById('frame').src)", client)
        wait_for(browser, "document.getElementById('state').textContent === 'manual driving'", client, manual=True)
    wait_for(browser, "document.getElementById('state').textContent === 'waiting for the simulator'")


def test_the_slider_sets_the_speed(server: Server, browser: webdriver.Chrome) -> None:
    with server.client() as client:
        driven(client)
        browser.execute_script(
            "const s = document.getElementById('set-speed'); s.value = 27.5;"
            "s.dispatchEvent(new Event('input')); s.dispatchEvent(new Event('change'));"
        )
        wait_for(browser, "samples.length && samples.at(-1).set_speed === 27.5", client)
        assert text(browser, "set-speed-value") == "27.5"


def test_nothing_went_wrong_in_the_browser(browser: webdriver.Chrome) -> None:
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
