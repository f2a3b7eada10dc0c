"""Segments of driving logs: consecutive rows of one recording without a pause."""

from typing import Any

import pandas as pd

LONGEST_GAP = 1.0  # seconds; a longer pause between two rows separates segments


def breaks(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Mark the rows that begin a new segment: after a pause, in another recording, or where time runs backwards."""
    step = rows["time"].diff()
    return (step > LONGEST_GAP) | (step < 0) | (rows["recording"].diff() != 0)


def segment_numbers(rows: pd.DataFrame) -> "pd.Series[Any]":
    """Return the number of each row's segment."""
    return breaks(rows).cumsum()
