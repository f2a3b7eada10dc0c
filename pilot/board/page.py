"""The board as one static page, board.html: a sortable table, the comparison of models in pairs, and maps."""

import itertools
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template

import numpy as np

from pilot.board.measurement import Result, clip_file
from pilot.board.points import WEIGHTS, bootstrap, mean_points, paired_p_value, rank_agreement
from pilot.board.suite import SPEED, Suite
from pilot.files import write_atomically
from pilot.simulator.scores import wilson

PAGE = "board.html"
UNSURE = 0.05  # p-value above which a difference may be chance
ERROR = "error, m"
COLUMNS = ("driver", "network", "points", "95 %", *WEIGHTS, "interventions", "clean drives", ERROR, "mph")


def write_page(folder: Path, suite: Suite, results: Sequence[Result]) -> Path:
    """Write the page with all results, the best first; returns its path.

    Raises:
        OSError: the file cannot be written.
    """
    ranked = rank(results)
    template = Template(resources.files("pilot.board").joinpath("board.html").read_text(encoding="utf-8"))
    agreement = rank_agreement([result.drives for result in ranked], [drive.half for drive in suite.drives])
    text = template.substitute(
        version=escape(suite.version),
        drives=len(suite.drives),
        description=escape(suite.description),
        latencies="".join(f'<th class="number">{latency} ms</th>' for latency in latencies(suite)),
        by_latency="\n".join(_by_latency(suite, result) for result in ranked),
        speed=f"{SPEED:g}",
        agreement=f"{agreement:.2f}" if np.isfinite(agreement) else "–",
        head="".join(f'<th scope="col"><button>{escape(column)}</button></th>' for column in COLUMNS),
        rows="\n".join(map(_row, ranked)),
        pairs=_pairs(ranked),
        details="\n".join(_details(folder, result) for result in ranked),
    )
    path = folder / PAGE
    write_atomically(path, lambda file: file.write(text.encode()))
    return path


def rank(results: Sequence[Result]) -> list[Result]:
    """Return the results in the order of their points, the best first."""
    return sorted(results, key=lambda result: -mean_points(result.drives))


def figures(result: Result) -> dict[str, float | str]:
    """Return the cells of a result's row, by column."""
    drives = result.drives
    low, high = bootstrap(drives)
    clean = sum(not drive.interventions for drive in drives)
    clean_low, clean_high = wilson(clean, len(drives))
    return {
        "driver": result.name,
        "network": result.network,
        "points": mean_points(drives),
        "95 %": f"{low:.1f} to {high:.1f}",
        **{part: float(np.mean([drive.parts[part] for drive in drives])) for part in WEIGHTS},
        "interventions": float(sum(drive.interventions for drive in drives)),
        "clean drives": f"{clean} of {len(drives)} ({100 * clean_low:.0f} to {100 * clean_high:.0f} %)",
        ERROR: float(np.mean([drive.cross_track for drive in drives])),
        "mph": float(np.mean([drive.speed for drive in drives])),
    }


def _row(result: Result) -> str:
    cells = figures(result)
    link = f'<a href="#{escape(result.name, quote=True)}">{escape(result.name)}</a>'
    return f"<tr>{''.join(_cell(column, value, link) for column, value in cells.items())}</tr>"


def _cell(column: str, value: float | str, link: str) -> str:
    if column == "driver":
        return f'<th scope="row">{link}</th>'
    if isinstance(value, str):
        return f"<td>{escape(value)}</td>"
    digits = {"interventions": 0, ERROR: 2}.get(column, 1)
    return f'<td class="number" data-value="{value:.6f}">{value:.{digits}f}</td>'


def latencies(suite: Suite) -> list[int]:
    """Return the latencies of a suite's drives in ms, ascending."""
    return sorted({drive.latency_ms for drive in suite.drives})


def interventions_by_latency(suite: Suite, result: Result) -> list[int]:
    """Return the interventions of a driver with each of the latencies of a suite."""
    pairs = list(zip(suite.drives, result.drives, strict=True))
    return [
        sum(driven.interventions for drive, driven in pairs if drive.latency_ms == latency)
        for latency in latencies(suite)
    ]


def _by_latency(suite: Suite, result: Result) -> str:
    cells = "".join(f'<td class="number">{count}</td>' for count in interventions_by_latency(suite, result))
    return f"<tr><th scope='row'>{escape(result.name)}</th>{cells}</tr>"


def _pairs(ranked: Sequence[Result]) -> str:
    """Return rows with the difference of points between each driver and the next one, and its p-value."""
    rows = []
    for better, worse in itertools.pairwise(ranked):
        p_value = paired_p_value(better.drives, worse.drives)
        difference = mean_points(better.drives) - mean_points(worse.drives)
        verdict = "may be chance" if p_value > UNSURE else "better"
        rows.append(
            f"<tr><th scope='row'>{escape(better.name)}</th><td>{escape(worse.name)}</td>"
            f'<td class="number">{difference:.1f}</td><td class="number">{p_value:.4f}</td><td>{verdict}</td></tr>'
        )
    return "\n".join(rows)


def _details(folder: Path, result: Result) -> str:
    """Return the section of a driver: its maps, and a table of its drives with their clips."""
    name = escape(result.name, quote=True)
    clips = [clip_file(folder, result.name, number) for number in range(len(result.drives))]
    titles = [
        f'<a href="{name}/{clip.name}">{escape(drive.title)}</a>' if clip.exists() else escape(drive.title)
        for drive, clip in zip(result.drives, clips, strict=True)
    ]
    rows = "\n".join(
        f"<tr><th scope='row'>{title}</th><td class='number'>{drive.points:.1f}</td>"
        f"<td class='number'>{drive.interventions}</td><td class='number'>{drive.cross_track:.2f}</td>"
        f"<td class='number'>{drive.speed:.1f}</td></tr>"
        for title, drive in zip(titles, result.drives, strict=True)
    )
    picture = f'<img src="{name}.png" alt="Maps of the drives of {name}" loading="lazy">'
    shown = picture if (folder / f"{result.name}.png").exists() else ""
    return (
        f'<section id="{name}"><h2>{name}</h2>{shown}<details><summary>the {len(result.drives)} drives</summary>'
        f'<div class="scroll"><table><thead><tr><th>drive</th><th>points</th><th>interventions</th>'
        f"<th>cross-track error, m</th><th>mph</th></tr></thead><tbody>{rows}</tbody></table></div></details></section>"
    )


def text_table(suite: Suite, ranked: Sequence[Result]) -> str:
    """Return the main figures of all results as text, in the given order."""
    late = f"at {', '.join(map(str, latencies(suite)))} ms"
    lines = [
        f"{'':28} {'points':>6}  {'95 %':15} {'interventions':>13}  {'clean drives':24} {'cross-track, m':>14} "
        f"{'mph':>5}  interventions {late}"
    ]
    for result in ranked:
        cells = figures(result)
        lines.append(
            f"{result.name:28} {cells['points']:6.1f}  {cells['95 %']:15} {cells['interventions']:13.0f}  "
            f"{cells['clean drives']:24} {cells[ERROR]:14.2f} {cells['mph']:5.1f}  "
            f"{', '.join(map(str, interventions_by_latency(suite, result)))}"
        )
    return "\n".join(lines)
