"""The closed loop: who drives well gets good scores, and nothing keeps an evaluation from its end."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY, picture

from pilot.arrays import Frame
from pilot.driving.controller import ControllerConfig
from pilot.driving.plan import Plan
from pilot.evaluation.closed_loop import (
    Delay,
    DriveRequest,
    ModelPolicy,
    SteeringPolicy,
    drive_laps,
    expert_policy,
    run,
    run_together,
)
from pilot.evaluation.conditions import Conditions, expand_tracks
from pilot.evaluation.over_socket import run_over_socket
from pilot.evaluation.scenarios import TrackScenario
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, save_model
from pilot.pursuit import EXPERT, LOOKAHEAD
from pilot.signature import Signature
from pilot.simulator.episode import Episode
from pilot.simulator.referee import Referee, time_limit
from pilot.simulator.rendering.renderer import Renderer
from pilot.simulator.scores import Scores, score
from pilot.simulator.track import STEP, Track, closed_road
from pilot.simulator.trajectory import Trajectory
from pilot.vehicle import Rows, curvature_to_steering
from pilot.workers import run_tasks

FRAME = picture(0.0)
SETUP = Conditions(laps=1.0, speed=ControllerConfig(speed=20.0))


@pytest.fixture(scope="module")
def winding() -> Track:
    """390 m of bends to both sides."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    radius = 55 + 9 * np.cos(3 * angles)
    return closed_road("winding", np.column_stack([radius * np.sin(angles), radius * np.cos(angles), 0 * angles]), 4.0)


def straight(_drive: Episode) -> SteeringPolicy:
    return lambda _frame: 0.0


def drive(track: Track, who: object = expert_policy, *, seed: int = 0, **changes: object) -> Trajectory:
    car = Episode(track)
    return drive_laps(car, lambda _: FRAME, who(car), dataclasses.replace(SETUP, **changes), seed=seed)


def scores(track: Track, who: object = expert_policy, **changes: object) -> Scores:
    return score("", [drive(track, who, **changes)])


def test_the_expert_needs_nobody(winding: Track) -> None:
    found = scores(winding)
    assert (found.interventions, found.autonomy) == (0, 100)
    assert found.laps == pytest.approx(1, abs=0.01)
    assert found.cross_track_max < 0.6
    assert found.lap_time == pytest.approx(found.seconds, abs=0.1)
    assert found.speed == pytest.approx(19.5, abs=1.5)


def test_straight_on_is_put_back_where_it_leaves_the_road_and_comes_to_the_end(winding: Track) -> None:
    driven = drive(winding, straight)
    found = score("", [driven])
    assert len(driven.interventions) > 5
    assert found.laps == pytest.approx(1, abs=0.01)
    assert found.cross_track_max == pytest.approx(3.0, abs=0.3)  # half of the road, less half of the car
    assert {each.reason for each in driven.interventions} == {"off the road"}
    after = np.searchsorted(driven.times, [each.time for each in driven.interventions]) + 1
    assert np.abs(driven.cross_track_errors[after]).max() < 0.05  # in the lane's middle again, a tick later
    assert driven.speeds[after[1:]].min() > 8  # at the speed it had


def test_latency_makes_it_worse(winding: Track) -> None:
    prompt, late = (scores(winding, laps=0.5, latency_ms=milliseconds) for milliseconds in (0, 800))
    assert late.cross_track_mean > 3 * prompt.cross_track_mean  # less of it helps the expert, who steers somewhat early
    assert late.steering_rate > 3 * prompt.steering_rate
    assert late.interventions > prompt.interventions == 0


def ahead(episode: Episode) -> SteeringPolicy:
    """An expert who tells the steering of the next second: of the bends there, and of a car that is on its way back."""

    class Policy:
        signature = Signature(horizons=(0.0, 0.25, 0.5, 0.75, 1.0))

        def __call__(self, _frame: Frame) -> Plan:
            metres = episode.car.speed * np.array(self.signature.horizons)
            bends = episode.track.curvature_ahead(episode.where.progress + LOOKAHEAD / 2, 30.0)
            there = EXPERT.after(metres, episode.where.lateral_offset, episode.state.heading_error)
            curvatures = EXPERT.curvature(bends[(metres / STEP).astype(int)], *there)
            return Plan(tuple(curvature_to_steering(curvatures)), self.signature.horizons)

    return Policy()


def test_a_plan_bridges_latency(winding: Track) -> None:
    late, planned = (scores(winding, who, latency_ms=800) for who in (expert_policy, ahead))
    assert late.interventions > planned.interventions == 0
    assert planned.steering_rate < late.steering_rate / 4  # it does not swing from side to side


def test_lost_frames_make_it_worse_by_their_seed(winding: Track) -> None:
    whole, torn, same, other = (
        drive(winding, laps=0.5, lost_frames=share, seed=seed)
        for share, seed in ((0.0, 1), (0.95, 1), (0.95, 1), (0.95, 2))
    )
    assert score("", [torn]).cross_track_max > 2 * score("", [whole]).cross_track_max
    assert np.array_equal(torn.positions, same.positions)
    assert not np.array_equal(torn.positions[:500], other.positions[:500])


def test_slow_in_curves_is_slower(winding: Track) -> None:
    slow = ControllerConfig(speed=20.0, slow_in_curves=1.0)
    assert scores(winding, laps=0.3, speed=slow).speed < scores(winding, laps=0.3).speed - 1


def test_a_command_waits_its_time() -> None:
    delay = Delay(3)
    delay.send(0, (0.5, 0.2))
    delay.send(2, (0.6, 0.3))
    assert [delay.at(tick)[0] for tick in range(6)] == [0, 0, 0, 0.5, 0.5, 0.6]
    delay.send(6, (0.7, 0.4))
    delay.straighten()
    assert delay.at(9) == (0.0, 0.3)


def test_a_car_that_gets_nowhere_is_put_back_and_the_drive_ends(winding: Track) -> None:
    car = Episode(winding)
    longest = time_limit(winding, 1.0, 20.0)
    assert longest == pytest.approx(winding.length / (0.25 * 20 * 0.44704))
    referee = Referee(car, laps=1.0, seconds=longest)
    while not referee.over:
        referee.observe(car.advance(0.0, 0.0))
        assert referee.ticks < 20000
    assert car.ticks * 0.02 == pytest.approx(longest, abs=0.1)
    assert len(referee.interventions) == longest // 10
    assert {each.reason for each in referee.interventions} == {"no progress"}


def test_driving_backwards_is_no_progress(winding: Track) -> None:
    car = Episode(winding)
    car.place(20.0, heading_error=math.pi, speed=2.0)
    referee = Referee(car, laps=1.0)
    while not referee.interventions:
        referee.observe(car.advance(0.0, 0.0))
    assert referee.interventions[0].progress < -3
    assert referee.interventions[0].reason == "no progress"
    assert abs(car.state.heading_error) < 0.01


def test_only_what_the_driver_looks_at_is_rendered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rendered: list[Rows] = []
    render = Renderer.render

    def observed(self: Renderer, *place: float, rows: Rows, **options: object) -> dict[str, Frame]:
        rendered.append(rows)
        return render(self, *place, rows=rows, **options)

    monkeypatch.setattr(Renderer, "render", observed)
    model = ModelPolicy(REPOSITORY / "models" / "built_in.pt")
    short = Conditions(laps=0.001)
    for driver, clip in ((model, None), (model, tmp_path / "clip.mp4"), (straight, None)):
        run(DriveRequest(driver, "lake", short, clip=clip))
        assert rendered[-1] == ((64, 144) if driver is model and clip is None else (0, 160))
    rendered.clear()
    run(DriveRequest(expert_policy, "lake", short))
    assert len(rendered) == 1  # that of the reset


def test_a_drive_is_the_same_whether_all_rows_are_rendered_or_those_that_the_model_sees(tmp_path: Path) -> None:
    model = ModelPolicy(REPOSITORY / "models" / "built_in.pt")
    seen, whole = (
        run(DriveRequest(model, "jungle", Conditions(laps=0.02), start=3, clip=clip))
        for clip in (None, tmp_path / "clip.mp4")
    )
    assert np.array_equal(seen.positions, whole.positions)
    assert np.array_equal(seen.steering, whole.steering)


def test_side_by_side_in_one_process_the_drives_are_the_same_to_the_bit() -> None:
    model = ModelPolicy(REPOSITORY / "models" / "built_in.pt")
    requests = [
        DriveRequest(model, track, Conditions(laps=laps, lost_frames=0.1), start=start)
        for track, laps, start in (("jungle", 0.01, None), ("jungle reversed", 0.02, 4), ("jungle", 0.005, 5))
    ]
    for alone, together in zip(map(run, requests), run_together(requests), strict=True):
        assert np.array_equal(alone.positions, together.positions)
        assert np.array_equal(alone.steering, together.steering)
        assert alone.interventions == together.interventions


def test_the_processes_share_the_starts_of_a_track() -> None:
    starts = tuple(range(20))
    scenario = TrackScenario("lake", None, starts, SETUP)

    def sizes(processes: int, clips: Path | None = None) -> list[int]:
        return [len(task.args[0]) for task in scenario.drive_tasks(expert_policy, clips, processes)]

    assert sizes(5) == [4] * 5
    assert sizes(1) == [8, 8, 4]  # no more at once
    assert sizes(5, Path("clips")) == [1] * 20
    assert sizes(100) == [1] * 20


def test_a_driver_that_fails_ends_the_evaluation(winding: Track) -> None:
    def fail(_frame: object) -> float:
        raise ZeroDivisionError

    with pytest.raises(RuntimeError, match="the model failed"):
        drive(winding, lambda _: fail)


def test_side_by_side_or_one_after_another_the_scores_are_the_same() -> None:
    conditions = Conditions(laps=0.01, lost_frames=0.3)
    requests = [
        DriveRequest(expert_policy, track, conditions, start=start)
        for track, start in (("mountain", 1), ("mountain", 2))
    ]
    alone, together = (dict(run_tasks(run, requests, jobs)) for jobs in (1, 2))
    first, second = ([score("", [driven[number]]) for number in range(2)] for driven in (alone, together))
    assert first == second
    assert first[0] != first[1]  # each from its own start place


def test_through_the_socket(tmp_path: Path) -> None:
    save_model(tmp_path / "model.pt", Model("pilotnet", build_network("pilotnet", 1), {}, {}, {}))
    request = DriveRequest(ModelPolicy(tmp_path / "model.pt"), "mountain", Conditions(laps=0.01))
    found = score("", [run_over_socket(request)])
    assert found.laps == pytest.approx(0.01, abs=0.005)
    assert found.speed > 3


def test_drive_py_s_last_words_are_passed_on(tmp_path: Path) -> None:
    request = DriveRequest(ModelPolicy(tmp_path / "absent.pt"), "mountain", Conditions(laps=0.02))
    with pytest.raises(RuntimeError, match="absent.pt: no such file"):
        run_over_socket(request)


def test_ranges_of_tracks() -> None:
    assert expand_tracks(["lake", "random:8-10", "random:9", "lake reversed", "random:0-1 reversed"]) == [
        "lake",
        "random:8",
        "random:9",
        "random:10",
        "lake reversed",
        "random:0 reversed",
        "random:1 reversed",
    ]
    with pytest.raises(ValueError, match="from less to more"):
        expand_tracks(["random:5-2"])
