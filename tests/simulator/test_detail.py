"""The level of detail of the terrain: every cell is drawn once, without gaps, and in full detail near the road."""

import numpy as np

from pilot.simulator.rendering.detail import AWAY, corners_of_squares, flattened, square_sizes

ROWS, COLUMNS = 49, 65  # grid points: a multiple of 8, plus 1
AWAY_FROM_ROAD = np.hypot(*np.meshgrid(5.0 * np.arange(COLUMNS) - 90, 5.0 * np.arange(ROWS) - 70))
SIZES = square_sizes(AWAY_FROM_ROAD)
HEIGHTS = np.random.default_rng(0).normal(0, 3, (ROWS, COLUMNS))
PLACES = np.stack(np.meshgrid(np.arange(float(COLUMNS)), np.arange(float(ROWS))), -1)


def test_the_squares_cover_each_cell_once() -> None:
    covered = np.zeros((ROWS - 1, COLUMNS - 1), int)
    for size in (1, 2, 4, 8):
        squares = corners_of_squares(PLACES, SIZES, size)
        assert len(squares)
        for column, row in squares.min(1).astype(int):
            covered[row : row + size, column : column + size] += 1
        np.testing.assert_array_equal(np.ptp(squares, axis=1), size)
    np.testing.assert_array_equal(covered, 1)


def test_squares_are_larger_only_where_the_road_is_far() -> None:
    for size in (2, 4, 8):
        columns, rows = corners_of_squares(PLACES, SIZES, size).astype(int).T
        assert AWAY_FROM_ROAD[rows, columns].min() > AWAY * size
    assert (SIZES[AWAY_FROM_ROAD[1:, 1:] < 2 * AWAY] == 1).all()


def test_no_gap_opens_beside_a_larger_square() -> None:
    flat = flattened(HEIGHTS, SIZES)
    for size in (2, 4, 8):
        for square in corners_of_squares(PLACES, SIZES, size).astype(int):
            for (column, row), (to_column, to_row) in zip(square, np.roll(square, -1, axis=0), strict=True):
                columns, rows = np.linspace(column, to_column, size + 1), np.linspace(row, to_row, size + 1)
                edge = flat[rows.astype(int), columns.astype(int)]
                np.testing.assert_allclose(edge, np.linspace(edge[0], edge[-1], size + 1), atol=1e-9)


def test_near_the_road_the_heights_are_kept() -> None:
    near = AWAY_FROM_ROAD < 2 * AWAY
    np.testing.assert_array_equal(flattened(HEIGHTS, SIZES)[near], HEIGHTS[near])
