"""Roads: geometry, well-formedness, and where a car stands on them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pilot.simulator.catalogue import load_course, track_names
from pilot.simulator.course import LIGHTS
from pilot.simulator.track import CLEARANCE, MIN_RADIUS, STEP, Track, closed_road, crossings, validated

EVERY_NAME = [*track_names(), *(f"random:{seed}" for seed in range(12))]


def circle(radius: float = 50.0, half_width: float = 4.0) -> Track:
    """Driven clockwise: it bends to the right."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return closed_road(
        "circle", np.column_stack([radius * np.sin(angles), radius * np.cos(angles), 0 * angles]), half_width
    )


def test_a_circle_has_its_length_curvature_and_headings() -> None:
    track = circle()
    assert track.length == pytest.approx(2 * math.pi * 50, abs=0.6)
    assert track.curvatures == pytest.approx(1 / 50, rel=0.01)
    assert track.at(0)[2] == pytest.approx(math.pi / 2, abs=0.01)  # at the top of a clockwise circle: east
    assert track.reversed().curvatures == pytest.approx(-1 / 50, rel=0.01)


@given(st.floats(0, 2000), st.floats(-3.5, 3.5), st.booleans())
@settings(max_examples=60, deadline=None)
def test_locate_is_the_inverse_of_at(progress: float, offset: float, backwards: bool) -> None:
    track = load_course("jungle").track
    track = track.reversed() if backwards else track
    x, y, heading = track.at(progress, offset)
    at_crossing = min(math.dist((x, y), track.points[index, :2]) for pair in crossings(track) for index in pair) < 10
    nearby = progress % track.length + 3.0
    for near in (nearby,) if at_crossing else (nearby, None):  # of two roads above each other, which one?
        place = track.locate(x, y, near)
        assert place.lateral_offset == pytest.approx(offset, abs=0.05)
        around = (place.progress - progress + track.length / 2) % track.length - track.length / 2
        assert around == pytest.approx(0, abs=0.3)
        assert math.cos(place.heading - heading) > 0.998  # in a hairpin, a segment of 0.5 m turns by 0.05 rad


def test_the_other_way_round_left_is_right() -> None:
    track = load_course("lake").track
    x, y, _ = track.at(200, 2.0)
    assert track.locate(x, y).lateral_offset == pytest.approx(2.0, abs=0.05)
    assert track.reversed().locate(x, y).lateral_offset == pytest.approx(-2.0, abs=0.05)
    assert track.reversed().name == "lake reversed"
    assert track.reversed().reversed().name == "lake"


@pytest.mark.parametrize("name", EVERY_NAME)
def test_every_course_is_well_formed(name: str) -> None:
    track = load_course(name).track
    assert np.linalg.norm(np.diff(track.points[:, :2], axis=0), axis=1) == pytest.approx(STEP, rel=0.02)
    assert np.linalg.norm(track.points[0, :2] - track.points[-1, :2]) == pytest.approx(STEP, rel=0.02)
    assert 1 / np.abs(track.curvatures).max() >= MIN_RADIUS
    assert np.abs(np.gradient(track.points[:, 2], STEP)[1:-1]).max() < 0.4  # a car gets up
    assert track.largest_offset - abs(track.lane) > 1.0


def test_random_courses_are_as_hard_as_the_real_tracks() -> None:
    tracks = [load_course(f"random:{seed}").track for seed in range(60)]
    tightest = np.array([1 / np.abs(track.curvatures).max() for track in tracks])
    assert (tightest < 10).mean() > 0.2
    assert (tightest > 14).mean() > 0.1
    assert sum(bool(crossings(track)) for track in tracks) >= 3
    assert max(np.ptp(track.points[:, 2]) for track in tracks) > 20
    courses = [load_course(f"random:{seed}") for seed in range(60)]
    kinds = {section.kind for course in courses for section in course.roadside}
    assert kinds >= {"hill", "cliff", "drop", "bank", "dirt", "grove", "signs", "bridge"}
    assert {course.light for course in courses} == set(LIGHTS)


def test_one_road_passes_above_the_other_where_they_cross() -> None:
    for name in ("jungle", *(f"random:{seed}" for seed in range(40))):
        course = load_course(name)
        for pair in crossings(course.track):
            heights = course.track.points[list(pair), 2]
            assert np.ptp(heights) >= CLEARANCE, name
            upper = pair[int(heights.argmax())]
            assert course.on_bridge()[upper], name
            assert not course.on_bridge()[pair[int(heights.argmin())]], name


def test_at_a_crossing_the_car_stays_on_its_own_road() -> None:
    track = load_course("jungle").track
    ((upper, lower),) = crossings(track)
    x, y = track.points[upper, :2]
    for index in (upper, lower):
        place = track.locate(x, y, near=index * STEP - 2.0)
        assert place.progress == pytest.approx(index * STEP, abs=1.0)
        assert place.height == pytest.approx(track.points[index, 2], abs=0.5)


def test_random_courses_differ_and_come_again() -> None:
    again, first, second = (load_course(name) for name in ("random:7", "random:7", "random:8"))
    assert np.array_equal(again.track.points, first.track.points)
    assert again.look == first.look
    assert second.track.length != first.track.length
    assert second.look != first.look


def test_lake_is_as_long_as_the_real_one_and_driven_counter_clockwise() -> None:
    track = load_course("lake").track
    assert track.length == pytest.approx(1138, rel=0.005)
    assert track.headings[-1] - track.headings[0] == pytest.approx(-2 * math.pi, abs=0.1)


def test_jungle_has_the_real_ones_length_heights_and_hairpins() -> None:
    track = load_course("jungle").track
    assert track.length == pytest.approx(1495, rel=0.005)
    assert track.points[:, 2].min() == pytest.approx(-95, abs=0.5)
    assert track.points[:, 2].max() == pytest.approx(-65, abs=0.5)
    assert np.abs(track.curvatures).max() < 0.1 + 1e-6
    tightest = np.abs(np.abs(track.curvatures) - 0.1) < 1e-6  # quarter circles, and both arcs of the shifts
    assert tightest.sum() * STEP == pytest.approx(10 * 10 * math.pi / 2 + 18 * 2 * 10 * math.asin(0.6), abs=6)
    assert track.at(0)[2] % math.tau == pytest.approx(math.pi / 2)  # the car starts eastwards
    assert track.points[0, :2] == pytest.approx((170.6, -44.0), abs=0.5)


def test_refuses_what_is_no_road() -> None:
    eight = np.array(
        [[0, 0, 0], [60, 60, 0], [120, 0, 0], [60, -60, 0], [0, 0, 0], [-60, 60, 0], [-120, 0, 0], [-60, -60, 0]], float
    )
    with pytest.raises(ValueError, match="of itself"):
        validated(closed_road("eight", eight, 4.0))
    with pytest.raises(ValueError, match=r"a bend of 5.\d m radius is too tight"):
        validated(circle(radius=5.4))


@pytest.mark.parametrize("name", ["desert", "random", "random:", "random:-1", "random:x", ""])
def test_says_which_courses_there_are(name: str) -> None:
    with pytest.raises(ValueError, match="there are lake, jungle, mountain and random:SEED"):
        load_course(name)
