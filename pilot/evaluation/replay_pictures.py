"""Figures of replays: the path from above, the cross-track error, and the recorded and predicted steering."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from pilot.arrays import Floats
from pilot.evaluation.pictures import ASPHALT, GROUND, draw_paths, headline, mark_interventions, side_of_road
from pilot.evaluation.replay import LIMITS, Reference, Replayable, ReplaySegment
from pilot.simulator.scores import Scores
from pilot.simulator.trajectory import Trajectory

BREAK = 20.0  # metres on the axis between two segments
REFERENCE_LINES: dict[Reference, str] = {
    "road": "the recorded driver's usual line",
    "path": "the driver's smoothed path",
}


def draw_replay(title: str, recording: Replayable, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
    """Draw the replay of a recording, with one trajectory per segment.

    The left panel shows the paths from above; the right ones, over the recording's length, the cross-track error within
    its allowed range, and the recorded and predicted steering.
    """
    figure = Figure((14, 7), layout="constrained")
    axes = figure.subplot_mosaic([["above", "offsets"], ["above", "steering"]], width_ratios=(1, 1.6))
    figure.suptitle(headline(title, scores), fontsize=12)
    draw_paths(figure, axes["above"], _side_by_side(trajectories))
    axes["above"].set(aspect="equal", xlabel="metres, by steering and speed", title="the driven path")
    axes["above"].autoscale_view()
    axes["above"].set_facecolor(GROUND)
    begin = 0.0
    for segment, trajectory in zip(recording.segments, trajectories, strict=True):
        along = begin + trajectory.progress
        _draw_cross_track_errors(axes["offsets"], along, segment, trajectory, LIMITS[recording.reference])
        _draw_steering(axes["steering"], along, segment, trajectory)
        begin = float(along[-1]) + BREAK
    _finish(axes["offsets"], axes["steering"], f"relative to {REFERENCE_LINES[recording.reference]}")
    return figure


def _side_by_side(trajectories: Sequence[Trajectory]) -> list[Trajectory]:
    """Shift the trajectories, each of which starts near the origin, so that they do not overlap."""
    shifted, right = [], 0.0
    for trajectory in trajectories:
        shift = np.array([right - trajectory.positions[:, 0].min(), -trajectory.positions[:, 1].min()])
        right = float((trajectory.positions + shift)[:, 0].max()) + 4 * BREAK
        shifted.append(trajectory.shifted(*shift))
    return shifted


def _draw_cross_track_errors(
    axis: Axes, along: Floats, segment: ReplaySegment, trajectory: Trajectory, limit: float
) -> None:
    axis.fill_between(along, *segment.allowed_errors(limit), color=ASPHALT, linewidth=0)
    axis.plot(along, segment.driver, color="#555555", linewidth=0.9, linestyle="--")
    axis.plot(along, trajectory.cross_track_errors, color="C0", linewidth=1.1)
    mark_interventions(axis, along, trajectory)


def _draw_steering(axis: Axes, along: Floats, segment: ReplaySegment, trajectory: Trajectory) -> None:
    axis.plot(along, segment.rows["steering"], color="#999999", linewidth=0.8)
    axis.plot(along, trajectory.steering, color="C0", linewidth=1.0)


def _finish(offsets: Axes, steering: Axes, title: str) -> None:
    offsets.axhline(0, color="white", linewidth=1.2)
    offsets.invert_yaxis()  # as seen in the direction of driving: left is up
    offsets.yaxis.set_major_formatter(FuncFormatter(side_of_road))
    offsets.set(title=title, xlabel="metres along the recording", ylabel="cross-track error, m")
    offsets.set_facecolor(GROUND)
    patches = offsets.collections[:1] + offsets.lines[:2]
    offsets.legend(patches, ["allowed", "the driver", "the model"], loc="lower right", fontsize=9)
    steering.set(xlabel="metres along the recording", ylabel="steering, -1..1")
    steering.legend(steering.lines[:2], ["recorded", "predicted"], loc="lower right", fontsize=9)
