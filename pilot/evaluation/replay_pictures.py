"""Pictures of a replayed recording: the path from above, the place on the road, recorded and predicted steering."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from pilot.evaluation.pictures import ASPHALT, GROUND, draw_paths, headline, mark_interventions, side_of_road
from pilot.evaluation.replay import LIMITS, Reference, Replayable, Stretch
from pilot.evaluation.scores import Array, Driven, Scores

BREAK = 20.0  # metres on the drawn axis between two stretches
PLACES: dict[Reference, str] = {"road": "the usual place on the road", "path": "the driver's smoothed path"}


def draw_replay(title: str, recording: Replayable, drives: Sequence[Driven], scores: Scores) -> Figure:
    """What became of a replayed recording."""
    figure = Figure((14, 7), layout="constrained")
    axes = figure.subplot_mosaic([["above", "offsets"], ["above", "steering"]], width_ratios=(1, 1.6))
    place = PLACES[recording.reference]
    figure.suptitle(headline(title, scores, place), fontsize=12)
    draw_paths(figure, axes["above"], _side_by_side(drives), place)
    axes["above"].set(aspect="equal", xlabel="metres, by steering and speed", title="the driven path")
    axes["above"].autoscale_view()
    axes["above"].set_facecolor(GROUND)
    begin = 0.0
    for stretch, drive in zip(recording.stretches, drives, strict=True):
        along = begin + drive.progress
        _draw_offsets(axes["offsets"], along, stretch, drive, LIMITS[recording.reference])
        _draw_steering(axes["steering"], along, stretch, drive)
        begin = float(along[-1]) + BREAK
    _finish(axes["offsets"], axes["steering"], f"metres beside {place}")
    return figure


def _side_by_side(drives: Sequence[Driven]) -> list[Driven]:
    """The paths, each of which begins at 0, 0: moved so that they do not lie upon each other."""
    moved, right = [], 0.0
    for drive in drives:
        shift = np.array([right - drive.positions[:, 0].min(), -drive.positions[:, 1].min()])
        right = float((drive.positions + shift)[:, 0].max()) + 4 * BREAK
        moved.append(drive.moved(*shift))
    return moved


def _draw_offsets(axis: Axes, along: Array, stretch: Stretch, drive: Driven, limit: float) -> None:
    axis.fill_between(along, *stretch.allowed(limit), color=ASPHALT, linewidth=0)
    axis.plot(along, stretch.driver, color="#555555", linewidth=0.9, linestyle="--")
    axis.plot(along, drive.offsets, color="C0", linewidth=1.1)
    mark_interventions(axis, along, drive)


def _draw_steering(axis: Axes, along: Array, stretch: Stretch, drive: Driven) -> None:
    axis.plot(along, stretch.rows["steering"], color="#999999", linewidth=0.8)
    axis.plot(along, drive.steering, color="C0", linewidth=1.0)


def _finish(offsets: Axes, steering: Axes, measured: str) -> None:
    offsets.axhline(0, color="white", linewidth=1.2)
    offsets.invert_yaxis()  # seen in the direction of driving: left is up
    offsets.yaxis.set_major_formatter(FuncFormatter(side_of_road))
    offsets.set(xlabel="metres along the recording", ylabel=measured)
    offsets.set_facecolor(GROUND)
    patches = offsets.collections[:1] + offsets.lines[:2]
    offsets.legend(patches, ["allowed", "the driver", "the model"], loc="lower right", fontsize=9)
    steering.set(xlabel="metres along the recording", ylabel="steering, -1..1")
    steering.legend(steering.lines[:2], ["recorded", "predicted"], loc="lower right", fontsize=9)
