"""Where a driving log breaks off: a segment is what was driven in one go."""

from typing import Any

import pandas as pd

LONGEST_GAP = 1.0  # seconds; rows further apart than this are not of one drive


def breaks(rows: pd.DataFrame) -> "pd.Series[bool]":
    """True for each row that does not follow the one before it: another recording, a pause, or time runs back."""
    step = rows["time"].diff()
    return (step > LONGEST_GAP) | (step < 0) | (rows["recording"].diff() != 0)


def segment_numbers(rows: pd.DataFrame) -> "pd.Series[Any]":
    """Number of the segment that each row is in."""
    return breaks(rows).cumsum()
