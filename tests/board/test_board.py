"""The board: a suite that stays what it was, points, comparisons, and the page."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import needs_browser, opened_browser

from pilot.board.measurement import (
    Contestant,
    Result,
    in_one_scene,
    in_processes,
    measure_all,
    read_result,
    result_file,
    results_in,
    write_result,
)
from pilot.board.page import rank, write_page
from pilot.board.points import DrivePoints, bootstrap, judge, mean_points, paired_p_value, rank_agreement
from pilot.board.suite import SUITES, Suite
from pilot.commands import evaluate
from pilot.simulator.catalogue import load_track
from pilot.simulator.trajectory import Intervention, Trajectory

V1 = SUITES["v1"]


def test_the_suites_have_not_changed() -> None:
    """If this fails, results of different times are not comparable: what changed must become a new version."""
    assert V1.digest == "1028cffdc6c25d3b9a3eeb2d7a24e3939b100871990408f3f548151099c4a5b5"
    assert SUITES["long-v1"].digest == "4c1492a673b1048ecb86d27117299f7c403cbd37e6ac73cad5ea1aec37ebb18c"
    assert SUITES["latency-v1"].digest == "226d8c2113847afefdf1fc7747ab246ba4e8b6517af6158de74d0c8440b8c863"


@pytest.mark.parametrize("version", ["v1", "long-v1"])
def test_the_halves_of_a_suite_are_of_the_same_kind(version: str) -> None:
    for what in (
        lambda drive: drive.light,
        lambda drive: (drive.latency_ms, drive.lost_frames),
        lambda drive: drive.track if "random" not in drive.track else "random",
    ):
        first, second = (
            Counter(what(drive) for drive in SUITES[version].drives if drive.half == half) for half in (0, 1)
        )
        assert first == second


def trajectory(offset: float, interventions: int = 0, *, metres: float = 400.0) -> Trajectory:
    """A drive of 40 s at a constant distance from the middle of the lane."""
    times = np.linspace(0, 40, 2001)
    nothing = np.zeros_like(times)
    put_back = tuple(Intervention(10.0, 0.0, 0.0, 100.0, "off the road") for _ in range(interventions))
    progress = metres * times / 40
    return Trajectory(
        times, np.zeros((2001, 2)), nothing + 22, nothing, progress, nothing + offset, nothing, put_back, 1000.0
    )


def test_points_of_a_drive() -> None:
    lake = load_track("lake")
    in_the_middle = judge("drive", lake, trajectory(0.0))
    assert in_the_middle.parts == pytest.approx(
        {"autonomy": 100, "completion": 100, "centring": 100, "calmness": 100, "pace": 100 * 10 / (30 * 0.44704)}
    )
    assert in_the_middle.points == pytest.approx(90 + 10 * 10 / (30 * 0.44704))
    assert judge("drive", lake, trajectory(1.0)).parts["centring"] < 100
    failed = judge("drive", lake, trajectory(0.0, interventions=2))
    assert (failed.parts["autonomy"], failed.parts["completion"]) == (pytest.approx(70), 0)


def drives(points: float, spread: float = 0.0, seed: int = 0) -> tuple[DrivePoints, ...]:
    """The drives of the suite, with normally distributed autonomy."""
    random = np.random.default_rng(seed)
    other = {"completion": 0.0, "centring": 0.0, "calmness": 0.0, "pace": 0.0}
    return tuple(
        DrivePoints(drive.title, {"autonomy": points + spread * random.normal(), **other}, 1, 40.0, 0.5, 22.0)
        for drive in V1.drives
    )


def test_intervals_and_p_values() -> None:
    low, high = bootstrap(drives(50, spread=10))
    assert low < mean_points(drives(50, spread=10)) < high
    assert high - low == pytest.approx(0.4 * 2 * 1.96 * 10 / np.sqrt(48), rel=0.3)
    assert paired_p_value(drives(50, 10), drives(50, 10, seed=1)) > 0.05
    assert paired_p_value(drives(60, 5), drives(50, 5, seed=1)) < 0.001
    assert paired_p_value(drives(50), drives(50)) == 1.0


def test_rank_agreement_of_halves() -> None:
    halves = [drive.half for drive in V1.drives]
    assert rank_agreement([drives(10), drives(20), drives(30)], halves) == 1.0
    turned = tuple(
        replace(each, parts={**each.parts, "autonomy": 30.0 if half else 5.0})
        for each, half in zip(drives(10), halves, strict=True)
    )
    assert rank_agreement([turned, drives(20)], halves) == -1.0
    # the turned training and a much better one of the same model: on average better in both halves
    assert rank_agreement([(*turned, *drives(70)), drives(20)], halves) == 1.0


def result(name: str, points: float) -> Result:
    return Result(name, "pilotnet", (V1.version, V1.digest), "0", drives(points, 3))


@needs_browser
def test_the_page_in_a_browser(tmp_path: Path) -> None:
    names = {"worst": 10.0, "best <b>": 90.0, "middle": 50.0}
    for name, points in names.items():
        write_result(result_file(tmp_path, name), result(name, points))
    page = write_page(tmp_path, V1, list(results_in(tmp_path, V1)))
    with opened_browser() as browser:
        browser.get(page.as_uri())

        def shown() -> list[str]:
            return [each.text for each in browser.find_elements("css selector", "#board tbody th")]

        assert shown() == ["best <b>", "middle", "worst"]
        points = browser.find_element("xpath", "//button[text()='points']")
        points.click()
        assert shown() == ["best <b>", "middle", "worst"]
        points.click()
        assert shown() == ["worst", "middle", "best <b>"]
        browser.find_element("xpath", "//button[text()='driver']").click()
        assert shown() == ["worst", "middle", "best <b>"]
        browser.set_window_size(500, 900)
        assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")


def test_results_of_another_suite_are_not_shown(tmp_path: Path) -> None:
    write_result(result_file(tmp_path, "old"), replace(result("old", 90), suite=("v1", "changed")))
    write_result(result_file(tmp_path, "now"), result("now", 10))
    assert [each.name for each in results_in(tmp_path, V1)] == ["now"]


def test_a_measurement_is_not_repeated_but_after_a_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = Suite("small", tuple(replace(drive, metres=8.0) for drive in V1.drives[:2]), "on short roads")
    expert = Contestant("expert", None)
    measure_all(small, [expert], tmp_path, in_processes(1))
    first = read_result(result_file(tmp_path, "expert"))
    assert first is not None
    assert [drive.interventions for drive in first.drives] == [0, 0]
    assert (tmp_path / "expert.png").stat().st_size > 10_000
    monkeypatch.setattr("pilot.board.measurement.drive", lambda *_: pytest.fail("measured again"))
    measure_all(small, [expert], tmp_path, in_processes(1))
    with pytest.raises(pytest.fail.Exception):
        measure_all(replace(small, version="other"), [expert], tmp_path, in_processes(1))


def test_rank_by_points() -> None:
    assert [each.name for each in rank([result("worse", 10), result("better", 90)])] == ["better", "worse"]


def test_a_suite_has_its_own_tracks(capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate.main(["expert", "--suite", "v1", "--tracks", "lake"]) == 1
    assert "--suite: has its own tracks and conditions" in capsys.readouterr().err


def test_a_scene_is_built_once_for_all_its_drives() -> None:
    requests = [drive.request(Contestant("expert", None).driver) for drive in V1.drives]
    groups = in_one_scene(requests)
    assert sorted(number for group in groups for number in group) == list(range(len(requests)))
    scenes = [{(requests[n].track.removesuffix(" reversed"), requests[n].light) for n in group} for group in groups]
    assert all(len(scene) == 1 for scene in scenes)
    assert len({scene.pop() for scene in scenes}) == len(groups) == 36
