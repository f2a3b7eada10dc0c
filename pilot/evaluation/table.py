"""Scores of one or more models as a text table and as JSON."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pilot.files import write_atomically
from pilot.simulator.scores import Interval, Scores

TABLE_COLUMNS = {
    "laps": ("laps", ".2f"),
    "lap_time": ("lap, s", ".1f"),
    "speed": ("mph", ".1f"),
    "interventions": ("interventions", "d"),
    "autonomy": ("autonomy, %", ".1f"),
    "cross_track_mean": ("cross-track, m", ".2f"),
    "cross_track_p95": ("p95, m", ".2f"),
    "cross_track_max": ("max, m", ".2f"),
    "heading_error": ("heading, °", ".1f"),
    "steering_rate": ("steering, 1/s", ".2f"),
    "steering_jerk": ("jerk, 1/s²", ".1f"),
}
COMPARED = ("interventions", "autonomy", "cross_track_mean", "steering_rate")  # columns for several models


@dataclass(frozen=True)
class Evaluation:
    """Scores of one model.

    Attributes:
        model: name of the model in tables.
        rows: scores of each scenario.
        total: scores of all scenarios together.
    """

    model: str
    rows: tuple[Scores, ...]
    total: Scores

    @property
    def lines(self) -> tuple[Scores, ...]:
        """Rows of a table: those of the scenarios, and the total if there are several."""
        return (*self.rows, self.total) if len(self.rows) > 1 else self.rows


def table(evaluations: Sequence[Evaluation]) -> str:
    """Return a text table with a row per scenario: all scores of one model, or the main scores of several models."""
    if len(evaluations) == 1:
        return _frame(evaluations[0], tuple(TABLE_COLUMNS)).to_string()
    frames = {evaluation.model: _frame(evaluation, COMPARED) for evaluation in evaluations}
    return str(pd.concat(frames, axis=1).to_string())


def _frame(evaluation: Evaluation, columns: Sequence[str]) -> pd.DataFrame:
    cells = [[_cell(getattr(scores, name), TABLE_COLUMNS[name][1]) for name in columns] for scores in evaluation.lines]
    titles = [scores.title for scores in evaluation.lines]
    return pd.DataFrame(cells, index=titles, columns=[TABLE_COLUMNS[name][0] for name in columns])


def _cell(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def verdict(evaluation: Evaluation) -> str:
    """Return a one-line summary of a model with 95 % confidence intervals."""
    total = evaluation.total
    return (
        f"{evaluation.model}: autonomy {total.autonomy:.1f} % ({_between(total.autonomy_interval)}), "
        f"{total.interventions} interventions in {total.seconds / 60:.1f} minutes; {total.clean} of {total.drives} "
        f"drives without one ({_between((100 * total.clean_interval[0], 100 * total.clean_interval[1]))})"
    )


def _between(interval: Interval) -> str:
    return f"95 % confidence: {interval[0]:.1f} to {interval[1]:.1f} %"


def write_json(path: Path, evaluations: Sequence[Evaluation], options: dict[str, Any]) -> None:
    """Write evaluations and the options of the evaluation to a JSON file, atomically.

    Raises:
        OSError: the file cannot be written.
    """
    content = {"options": options, "evaluations": [_to_jsonable(evaluation) for evaluation in evaluations]}
    text = json.dumps(content, indent=2, allow_nan=False, default=str)
    write_atomically(path, lambda file: file.write(text.encode()))


def _to_jsonable(evaluation: Evaluation) -> dict[str, Any]:
    return {
        "model": evaluation.model,
        "rows": [scores.to_jsonable() for scores in evaluation.rows],
        "total": evaluation.total.to_jsonable(),
    }


def read_json(path: Path) -> list[Evaluation]:
    """Read the evaluations from a file of `write_json`.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file does not contain evaluations.
    """
    try:
        return [_from_jsonable(item) for item in json.loads(path.read_text())["evaluations"]]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: holds no evaluations") from error


def _from_jsonable(item: dict[str, Any]) -> Evaluation:
    rows = tuple(map(Scores.from_jsonable, item["rows"]))
    return Evaluation(item["model"], rows, Scores.from_jsonable(item["total"]))
