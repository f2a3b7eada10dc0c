"""Scores: what they say about drives whose figures are known beforehand."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from pilot.evaluation.table import Evaluation, read_json, table, verdict, write_json
from pilot.simulator.scores import Scores, score, wilson
from pilot.simulator.trajectory import Intervention, Trajectory

SECONDS = 120.0
LAP = 500.0


def driven(
    seconds: float = SECONDS,
    interventions: int = 0,
    *,
    speed: float = 10.0,
    offset: float = 0.0,
    every: float = 0.02,
    lap: float | None = LAP,
) -> Trajectory:
    """Straight on at `speed` m/s, beside the lane's middle, the steering swinging ±0.5 each second and a half."""
    times = np.arange(round(seconds / every) + 1) * every
    steering = 0.5 * np.sign(np.sin(2 * math.pi * (times + 1e-6) / 1.5))
    taken = tuple(
        Intervention(float(time), 0, 0, speed * float(time), "off the road")
        for time in np.linspace(1, seconds - 1, interventions)
    )
    return Trajectory(
        times,
        np.column_stack([0 * times, speed * times]),
        np.full(len(times), speed / 0.44704),
        steering,
        speed * times,
        np.full(len(times), offset),
        np.full(len(times), math.radians(-2)),
        taken,
        lap,
    )


def test_autonomy_is_nvidias() -> None:
    scores = score("ten minutes", [driven(600, 10)])
    assert scores.autonomy == pytest.approx(90)  # the paper's own example
    low, high = scores.autonomy_interval
    assert 80 < low < 90 < high < 96
    assert score("one", [driven(60, 20)]).autonomy == pytest.approx(-100)  # as it is, below 0
    assert score("one", [driven(60, 20)]).autonomy_interval[0] == 0


def test_an_interval_shrinks_with_more_driving_and_is_never_a_point() -> None:
    widths = [high - low for low, high in (score("", [driven()] * count).autonomy_interval for count in (1, 4, 40))]
    assert widths[0] > widths[1] > widths[2] > 0


@pytest.mark.parametrize(
    ("lost", "trials", "low", "high"),
    [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (10, 10, 0.7225, 1.0), (0, 0, 0.0, 1.0)],
)
def test_wilson_intervals_are_the_textbooks(lost: int, trials: int, low: float, high: float) -> None:
    assert wilson(lost, trials) == pytest.approx((low, high), abs=1e-4)


def test_a_drive_in_figures() -> None:
    scores = score("straight", [driven(offset=-0.3)])
    assert (scores.cross_track_mean, scores.cross_track_p95, scores.cross_track_max) == pytest.approx((0.3, 0.3, 0.3))
    assert scores.heading_error == pytest.approx(2)
    assert scores.speed == pytest.approx(22.37, abs=0.01)
    assert scores.distance == pytest.approx(1200)
    assert scores.laps == pytest.approx(2.4)
    assert scores.lap_time == pytest.approx(50, abs=0.05)
    assert scores.steering_rate == pytest.approx(1 / 0.75, rel=0.02)  # by 1 each three quarters of a second
    assert scores.steering_jerk == pytest.approx(2 * scores.steering_rate / 0.1, rel=0.02)


def test_smoothness_does_not_depend_on_how_often_the_car_was_looked_at() -> None:
    often, seldom = (score("", [driven(every=every)]) for every in (0.02, 0.05))
    assert often.steering_rate == pytest.approx(seldom.steering_rate, rel=0.02)
    assert often.steering_jerk == pytest.approx(seldom.steering_jerk, rel=0.02)


def test_far_off_moments_show_in_the_tail() -> None:
    drive = driven()
    offsets = np.where(np.arange(len(drive.times)) % 100 < 8, 2.0, 0.1)  # 8 % of the time
    scores = score("", [dataclasses.replace(drive, cross_track_errors=offsets)])
    assert (scores.cross_track_p95, scores.cross_track_max) == (2.0, 2.0)
    assert scores.cross_track_mean == pytest.approx(0.25, abs=0.01)


def test_drives_are_pooled_by_time() -> None:
    pooled = score("all", [driven(60, 1, offset=1.0), driven(180, 0, offset=0.0)])
    assert (pooled.interventions, pooled.seconds, pooled.drives, pooled.clean) == (1, pytest.approx(240), 2, 1)
    assert pooled.autonomy == pytest.approx(97.5)
    assert pooled.cross_track_mean == pytest.approx(0.25, abs=0.001)
    assert pooled.clean_interval == pytest.approx((0.0945, 0.9055), abs=1e-3)


def test_where_there_are_no_laps_there_is_no_lap_time() -> None:
    scores = score("a recording", [driven(lap=None)])
    assert (scores.laps, scores.lap_time) == (None, None)
    assert score("less than a lap", [driven(20)]).lap_time is None
    assert "–" in table([Evaluation("model", (scores,), scores)])


def test_nothing_driven_is_refused() -> None:
    with pytest.raises(ValueError, match="lake: nothing was driven"):
        score("lake", [])


def test_json_gives_back_what_was_written(tmp_path: Path) -> None:
    rows = (score("lake", [driven(60, 2)]), score("a recording", [driven(lap=None)]))
    evaluation = Evaluation("model", rows, score("all", [driven(60, 2), driven(lap=None)]))
    path = tmp_path / "new" / "scores.json"
    write_json(path, [evaluation], {"laps": 1, "out": tmp_path})
    assert read_json(path) == [evaluation]
    plain = json.loads(path.read_text())
    assert plain["evaluations"][0]["rows"][0]["autonomy"] == pytest.approx(80)
    assert plain["options"]["laps"] == 1
    assert Scores.from_jsonable(plain["evaluations"][0]["total"]) == evaluation.total
    path.write_text("[]")
    with pytest.raises(ValueError, match="holds no evaluations"):
        read_json(path)


def test_the_table_has_a_row_per_track_and_models_side_by_side() -> None:
    rows = tuple(score(title, [driven(60, 3)]) for title in ("lake", "jungle reversed"))
    first = Evaluation("first", rows, score("all", [driven(60, 3)] * 2))
    lines = table([first]).splitlines()
    assert [line.split("  ")[0] for line in lines[1:]] == ["lake", "jungle reversed", "all"]
    assert "70.0" in lines[1]
    both = table([first, Evaluation("second", rows, first.total)]).splitlines()
    assert "first" in both[0]
    assert "second" in both[0]
    assert both[2].count("70.0") == 2
    assert "autonomy 70.0 %" in verdict(first)
    assert "0 of 2 drives" in verdict(first)
