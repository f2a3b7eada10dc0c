"""One picture of all drives of a suite: small maps of the roads with the driven paths and the interventions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pilot.board.suite import Suite
from pilot.evaluation.pictures import draw_path, draw_road_outline
from pilot.simulator.catalogue import load_track
from pilot.simulator.trajectory import Trajectory

COLUMNS = 6
SIZE = 2.1  # inches of a map


def draw_maps(name: str, suite: Suite, trajectories: Sequence[Trajectory]) -> Figure:
    """Draw a map of each road, with all its drives.

    Args:
        name: of the driver.
        suite: the drives.
        trajectories: in its order.
    """
    tracks = list(dict.fromkeys(drive.track for drive in suite.drives))
    rows = -(-len(tracks) // COLUMNS)
    figure = Figure((COLUMNS * SIZE, rows * (SIZE + 0.25)), layout="constrained")
    figure.suptitle(
        f"{name}, suite {suite.version}: paths by cross-track error (dark: none, yellow: 2 m), × interventions"
    )
    axes = np.atleast_1d(figure.subplots(rows, COLUMNS)).ravel()
    for axis, track in zip(axes, tracks, strict=False):
        driven = [each for drive, each in zip(suite.drives, trajectories, strict=True) if drive.track == track]
        _draw_map(axis, track, driven)
    for axis in axes[len(tracks) :]:
        axis.axis("off")
    return figure


def _draw_map(axis: Axes, track: str, trajectories: Sequence[Trajectory]) -> None:
    draw_road_outline(axis, load_track(track))
    for trajectory in trajectories:
        draw_path(axis, trajectory)
    interventions = sum(len(trajectory.interventions) for trajectory in trajectories)
    axis.set_title(f"{track}: {interventions}" if interventions else track, fontsize=8)
    axis.set(xticks=[], yticks=[])
