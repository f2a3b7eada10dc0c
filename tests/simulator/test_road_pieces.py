"""Roads from pieces: shapes, ramps, and what is refused."""

import math

import numpy as np
import pytest

from pilot.simulator.road_pieces import laid_out_road, lay_out, parse_layout

OVAL = "5S R20 R20 5S R20 R20"


def test_an_oval_closes_and_has_the_length_of_its_pieces() -> None:
    track = laid_out_road("oval", parse_layout(OVAL), (0, 0, 0), 0.0, 4.0)
    assert track.length == pytest.approx(100 + 2 * math.pi * 20, abs=0.5)
    assert track.curvatures.max() == pytest.approx(1 / 20)
    assert track.points[:, 0].max() == pytest.approx(40, abs=0.1)  # bends to the right: eastwards


def test_the_start_line_can_lie_within_the_road() -> None:
    track = laid_out_road("oval", parse_layout(OVAL), (0, 0, 0), 0.0, 4.0, start=20.0)
    assert track.points[0, :2] == pytest.approx((0, 20), abs=0.3)


@pytest.mark.parametrize(
    ("piece", "end", "turned"),
    [
        ("S", (0, 10, 0), 0),
        ("S25", (0, 25, 0), 0),
        ("R20", (20, 20, 0), 90),
        ("L10-", (-10, 10, -5), -90),
        ("R20:180", (40, 0, 0), 180),
        ("r", (10, 20, 0), 0),
        ("l+", (-10, 20, 5), 0),
    ],
)
def test_each_piece_ends_where_it_should(piece: str, end: tuple[float, float, float], turned: float) -> None:
    curve = lay_out(parse_layout(piece), (0, 0, 0), 0.0)
    assert curve[-1, :3] == pytest.approx(end, abs=0.01)
    assert math.degrees(curve[-1, 3]) == pytest.approx(turned, abs=0.01)


@pytest.mark.parametrize("piece", ["r", "L10", "R30:45"])
def test_headings_and_curvatures_are_those_of_the_points(piece: str) -> None:
    curve = lay_out(parse_layout(piece), (0, 0, 0), 0.3)
    steps = np.diff(curve[:, :2], axis=0)
    headings = np.arctan2(steps[:, 0], steps[:, 1])
    assert curve[:-1, 3] == pytest.approx(headings, abs=0.02)
    turns = np.diff(headings) / np.linalg.norm(steps[1:], axis=1)
    within = (curve[:-2, 4] == curve[1:-1, 4]) & (curve[1:-1, 4] == curve[2:, 4])  # curvature jumps where arcs end
    assert (~within).sum() <= 4
    assert curve[1:-1, 4][within] == pytest.approx(turns[within], abs=0.01)


@pytest.mark.parametrize("layout", ["X20", "S5 r3x", "20"])
def test_refuses_what_is_no_piece(layout: str) -> None:
    with pytest.raises(ValueError, match="piece"):
        parse_layout(layout)


def test_refuses_a_road_that_does_not_close() -> None:
    with pytest.raises(ValueError, match=r"open: the road ends 10.0 m and 0.0 degrees from where it began"):
        laid_out_road("open", parse_layout("S"), (0, 0, 0), 0.0, 4.0)
