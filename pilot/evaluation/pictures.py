"""Figures of episodes: the paths on the road from above, and the cross-track errors along the lap."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from pilot.arrays import Floats
from pilot.simulator.scores import Scores
from pilot.simulator.track import Track
from pilot.simulator.trajectory import Trajectory
from pilot.vehicle import HALF_TRACK

ASPHALT, EDGE, GROUND = "#d6d6d2", "#77776f", "#eef0e8"
REASONS = {"off the road": ("X", "#d0021b"), "no progress": ("s", "#7b1fa2")}  # marker and colour
FAR_OUT = 2.0  # metres; the cross-track error at the end of the colour scale
MARGIN = 0.7  # metres shown beyond the allowed cross-track errors
JUMP = 2.0  # metres between consecutive positions; at least as much means that the car was put back


def draw_trajectories(title: str, track: Track, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
    """Draw one or more episodes on a track: the paths from above, and the cross-track errors along the lap."""
    figure = Figure((14, 6), layout="constrained")
    above, along = figure.subplots(1, 2, width_ratios=(1, 1.25))
    figure.suptitle(headline(title, scores), fontsize=12)
    _draw_road(above, track)
    draw_paths(figure, above, trajectories)
    _draw_cross_track_errors(along, track, trajectories)
    return figure


def headline(title: str, scores: Scores) -> str:
    """Return the main scores in one line."""
    text = f"{scores.interventions} intervention{'s' * (scores.interventions != 1)}, autonomy {scores.autonomy:.1f} %"
    return f"{title}: {text}, mean cross-track error {scores.cross_track_mean:.2f} m"


def _draw_road(axis: Axes, track: Track) -> None:
    draw_road_outline(axis, track)
    line = np.stack([track.beside(side * track.half_widths)[0, :2] for side in (-1, 1)])
    axis.plot(line[:, 0], line[:, 1], color="black", linewidth=2.5, solid_capstyle="butt")
    beside = track.beside(track.half_widths + 10)[:, :2]
    axis.annotate("", beside[60], beside[0], arrowprops={"arrowstyle": "-|>", "color": "black"})
    axis.set(xlabel="metres to the east", ylabel="metres to the north")


def draw_road_outline(axis: Axes, track: Track) -> None:
    """Draw a road from above, in true proportions."""
    left, right = (_closed(track.beside(side * track.half_widths)[:, :2]) for side in (-1, 1))
    outline = np.vstack([left, right[::-1]])
    axis.fill(outline[:, 0], outline[:, 1], color=ASPHALT, linewidth=0)
    for edge in (left, right):
        axis.plot(edge[:, 0], edge[:, 1], color=EDGE, linewidth=0.8)
    axis.set_facecolor(GROUND)
    axis.set(aspect="equal")
    axis.margins(0.06)


def _closed(points: Floats) -> Floats:
    return np.vstack([points, points[:1]])


def draw_paths(figure: Figure, axis: Axes, trajectories: Sequence[Trajectory]) -> None:
    """Draw the paths from above, coloured by absolute cross-track error, and the interventions.

    Args:
        figure: receives the colour bar.
        axis: axes of the paths.
        trajectories: at least one.
    """
    for trajectory in trajectories:
        lines = draw_path(axis, trajectory, marked=False)
    figure.colorbar(lines, ax=axis, label="absolute cross-track error, m", extend="max", shrink=0.8, pad=0.02)
    for reason, (marker, colour) in REASONS.items():
        places = np.array(
            [
                (each.x, each.y)
                for trajectory in trajectories
                for each in trajectory.interventions
                if each.reason == reason
            ]
        )
        if len(places):
            axis.scatter(
                places[:, 0],
                places[:, 1],
                s=55,
                marker=marker,
                color=colour,
                edgecolors="white",
                linewidths=0.8,
                zorder=3,
                label=f"intervention: {reason} ({len(places)})",
            )
    if axis.get_legend_handles_labels()[1]:
        axis.legend(loc="upper right", fontsize=9)


def draw_path(axis: Axes, trajectory: Trajectory, *, marked: bool = True) -> LineCollection:
    """Draw a path from above, coloured by absolute cross-track error, and its interventions if they are `marked`."""
    segments = np.stack([trajectory.positions[:-1], trajectory.positions[1:]], 1)
    continuous = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) < JUMP
    lines = LineCollection(list(segments[continuous]), cmap="plasma", linewidth=1.6, capstyle="round")
    lines.set_array(np.abs(trajectory.cross_track_errors[1:][continuous]))
    lines.set_clim(0, FAR_OUT)
    axis.add_collection(lines)
    for each in trajectory.interventions if marked else ():
        marker, colour = REASONS[each.reason]
        axis.plot(each.x, each.y, marker, color=colour, markersize=7, markeredgecolor="white", markeredgewidth=0.6)
    return lines


def _draw_cross_track_errors(axis: Axes, track: Track, trajectories: Sequence[Trajectory]) -> None:
    places = np.arange(len(track.points)) * track.length / len(track.points)
    lowest, highest = (side * (track.half_widths - HALF_TRACK) - track.lane for side in (-1, 1))
    axis.fill_between(places, lowest, highest, color=ASPHALT, linewidth=0, label="rear wheels on the road")
    axis.axhline(0, color="white", linewidth=1.2)
    for number, trajectory in enumerate(trajectories):
        place = track.locate(*trajectory.positions[0]).progress + trajectory.progress
        for part in _pieces(trajectory, place // track.length):
            axis.plot(
                place[part] % track.length, trajectory.cross_track_errors[part], color=f"C{number % 10}", linewidth=1.1
            )
        mark_interventions(axis, place % track.length, trajectory)
    # as seen in the direction of driving: left is up
    axis.set(xlim=(0, track.length), ylim=(highest.max() + MARGIN, lowest.min() - MARGIN))
    axis.set(xlabel="metres along the lap", ylabel="cross-track error, m")
    axis.yaxis.set_major_formatter(FuncFormatter(side_of_road))
    axis.set_facecolor(GROUND)
    axis.legend(loc="lower right", fontsize=9)


def mark_interventions(axis: Axes, along: Floats, trajectory: Trajectory) -> None:
    """Mark the interventions in a plot of the n cross-track errors over `along` (n, metres)."""
    for each in trajectory.interventions:
        index = int(np.searchsorted(trajectory.times, each.time - 1e-9))
        marker, colour = REASONS[each.reason]
        axis.plot(
            along[index],
            trajectory.cross_track_errors[index],
            marker,
            color=colour,
            markersize=8,
            markeredgecolor="white",
            markeredgewidth=0.8,
        )


def _pieces(trajectory: Trajectory, laps: Floats) -> Iterator[slice]:
    """Yield slices that are plotted as separate lines: a new one begins with each lap and after each intervention."""
    put_back = np.isin(trajectory.times[:-1], [each.time for each in trajectory.interventions])
    cuts = np.flatnonzero((np.diff(laps) != 0) | put_back) + 1
    for first, last in zip([0, *cuts], [*cuts, len(laps)], strict=True):
        yield slice(int(first), int(last))


def side_of_road(metres: float, _position: int) -> str:
    """Format a cross-track error in metres as a tick label; a function for `FuncFormatter`."""
    return f"{abs(metres):g} left" if metres < 0 else f"{metres:g} right" if metres > 0 else "0"
