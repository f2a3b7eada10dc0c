"""The page in a real browser."""

from collections.abc import Iterator

import onnx
import pytest
from browser import needs_browser, opened_browser
from onnx import TensorProto, helper
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait
from serving import IMAGE, Server, driven, steers
from wire import WireClient, telemetry

from pilot.data.driving_log import read_driving_logs
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, save_model

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
        wait_for(browser, "document.getElementById('state').textContent === 'the model drives'", client)
        wait_for(browser, "document.getElementById('speed').textContent === '17.5'", client)
        wait_for(browser, "document.getElementById('frame').naturalWidth === 320", client)
        assert "frames/s" in text(browser, "rate")
        assert "ms per answer" in text(browser, "rate")
        assert "rotate" in browser.find_element(By.ID, "rim").get_attribute("style")
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


def press(browser: webdriver.Chrome, key: str, event: str) -> None:
    browser.execute_script(f"dispatchEvent(new KeyboardEvent('{event}', {{code: '{key}', key: '{key}'}}))")


def test_a_held_key_takes_over_and_gives_back(server: Server, browser: webdriver.Chrome) -> None:
    with server.client() as client:
        driven(client)
        press(browser, "ArrowLeft", "keydown")
        wait_for(browser, "document.getElementById('state').textContent === 'you drive'", client)
        wait_for(browser, "samples.at(-1).person && samples.at(-1).steering === -1", client)
        press(browser, "ArrowLeft", "keyup")
        wait_for(browser, "document.getElementById('state').textContent === 'the model drives'", client)
        wait_for(browser, "!samples.at(-1).person", client)
        assert text(browser, "corrected").startswith("1 correction in data/corrections/")
    wait_for(browser, "!document.getElementById('summary').hidden")
    assert "You took the wheel 1 time" in text(browser, "summary")


def test_the_wheel_can_be_dragged(server: Server, browser: webdriver.Chrome) -> None:
    wheel = browser.find_element(By.ID, "wheel")
    with server.client() as client:
        driven(client)
        wait_for(browser, "document.getElementById('summary').hidden", client)  # it moves the rest of the page
        pull = ActionChains(browser).move_to_element_with_offset(wheel, 0, -50).click_and_hold()
        pull.move_by_offset(50, 50).perform()  # a quarter turn to the right: 90 of 120 degrees
        wait_for(browser, "samples.at(-1).person && samples.at(-1).steering > 0.6", client)
        ActionChains(browser).release().perform()
        wait_for(browser, "!samples.at(-1).person", client)


def test_model_and_recording_are_chosen_on_the_page(server: Server, browser: webdriver.Chrome) -> None:
    save_model(server.folder / "other.pt", Model("nvidia", build_network("nvidia", 1), {}, {}, {}))
    browser.refresh()
    with server.client() as client:
        driven(client)
        wait_for(browser, "document.getElementById('model').options.length === 2", client)
        browser.execute_script(
            "const m = document.getElementById('model'); m.value = 'other.pt'; m.dispatchEvent(new Event('change'));"
        )
        wait_for(browser, "document.getElementById('network').textContent === 'network nvidia'", client)
        press(browser, "KeyR", "keydown")
        wait_for(browser, "/^[1-9][0-9]* frames in runs/.test(document.getElementById('recorded').textContent)", client)
        browser.find_element(By.ID, "record").click()
        wait_for(browser, "document.getElementById('recorded').textContent === 'not recording'", client)
    [run] = (server.folder / "runs").iterdir()
    assert len(read_driving_logs([run]).rows) >= 1


def test_an_onnx_file_drives_but_does_not_show_what_it_looks_at(server: Server, browser: webdriver.Chrome) -> None:
    frames = helper.make_tensor_value_info("frames", TensorProto.UINT8, ["n", 160, 320, 3])
    steering = helper.make_tensor_value_info("steering", TensorProto.FLOAT, [])
    nodes = [helper.make_node("Cast", ["frames"], ["pixels"], to=TensorProto.FLOAT)]
    nodes += [
        helper.make_node("ReduceMean", ["pixels"], ["mean"], keepdims=0),
        helper.make_node("Tanh", ["mean"], ["steering"]),
    ]
    graph = helper.make_graph(nodes, "brightness", [frames], [steering])
    onnx.save(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), server.folder / "a.onnx"
    )
    browser.refresh()
    with server.client() as client:
        driven(client)
        wait_for(browser, "document.getElementById('model').options.length === 3", client)
        assert browser.find_element(By.ID, "saliency").is_enabled()
        browser.execute_script(
            "const m = document.getElementById('model'); m.value = 'a.onnx'; m.dispatchEvent(new Event('change'));"
        )
        wait_for(browser, "document.getElementById('saliency').disabled", client)
        wait_for(browser, "document.getElementById('steering').textContent.startsWith('1.000')", client)


def test_fits_a_narrow_screen(browser: webdriver.Chrome) -> None:
    browser.set_window_size(500, 900)  # Chromium's window is not narrower; a phone's page is
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
    )
    wait_for(browser, "innerWidth === 390")
    assert browser.execute_script("return document.documentElement.scrollWidth") == 390
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_nothing_went_wrong_in_the_browser(browser: webdriver.Chrome) -> None:
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
