"""The text of a driving_log.csv, of any version of the simulator, taken apart line by line.

What is known about a line: first the names of up to three pictures, then numbers. Everything else
varies: header, separators, absolute paths of other machines (with commas in them), columns that a
spreadsheet added, and decimal commas that cut one number into two fields.
"""

import csv
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from pilot.vehicle import CAMERAS, PLAUSIBLE_SPEED_MPH

LOG_NAME = "driving_log.csv"
NUMBERS = ("steering", "throttle", "brake", "speed")
STEERING_NAMES = {"steering_angle": "steering", "angle": "steering", "steer": "steering"}

# Plausible values, by which a decimal comma is told from a separator.
RANGES = {"steering": (-1.0, 1.0), "throttle": (0.0, 1.0), "brake": (0.0, 1.0), "speed": (0.0, PLAUSIBLE_SPEED_MPH)}
# How much each value may change from row to row before it counts as a jump.
SCALES = {"steering": 1.0, "throttle": 1.0, "brake": 1.0, "speed": 3.0}

TIME_STAMP = re.compile(r"(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d{3})")
IMAGE_NAME = re.compile(r"\.(jpe?g|png|bmp)\s*$", re.IGNORECASE)
WHOLE_NUMBER = re.compile(r"-?\d+(E[+-]?\d+)?", re.IGNORECASE)


@dataclass
class LogLine:
    """One line of a log: picture names by camera, and numbers by name (only those it holds)."""

    number: int
    images: dict[str, str] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)
    fields: list[str] = field(default_factory=list)


def parse_log(text: str) -> Iterator[LogLine]:
    """Take the text of a driving_log.csv apart.

    Raises:
        ValueError: the header names no steering column.
    """
    records = list(_split(text))
    columns = list(NUMBERS)
    if records and (header := _header(records[0][1])):
        columns = header
        records = records[1:]
    lines = [_parse_record(number, record) for number, record in records]
    lines = [line for line in lines if line.images or line.fields]
    if _has_decimal_commas(lines, len(columns)):
        _join_decimal_commas(lines, columns)
    else:
        for line in lines:
            line.values = dict(zip(columns, line.fields, strict=False))
    yield from lines


def _split(text: str) -> Iterator[tuple[int, list[str]]]:
    """Numbered records of stripped fields, empty lines left out."""
    sample = text[:2000]
    separator = next((mark for mark in ";\t" if sample.count(mark) > sample.count(",")), ",")
    for number, line in enumerate(text.replace("\0", "").splitlines(), start=1):
        record = [part.strip() for part in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
        if separator != "," or '"' in line:  # then a comma inside a field is a decimal comma
            record = [re.sub(r"^(-?\d+),(\d+)", r"\1.\2", part) for part in record]
        if any(record):
            yield number, record


def _header(record: Sequence[str]) -> list[str]:
    """Names of the columns after the pictures if this record is a header, else nothing."""
    names = [STEERING_NAMES.get(name.lower(), name.lower()) for name in record]
    if not set(names) & {*CAMERAS, *NUMBERS} or any(IMAGE_NAME.search(name) for name in names):
        return []
    last_camera = max((index for index, name in enumerate(names) if name in CAMERAS), default=-1)
    if "steering" not in names[last_camera + 1 :]:
        raise ValueError(f"the header ({', '.join(record)}) names no 'steering' column after the pictures")
    return names[last_camera + 1 :]


def _parse_record(number: int, record: Sequence[str]) -> LogLine:
    line = LogLine(number)
    rest = 0
    for index, part in enumerate(record):
        if IMAGE_NAME.search(part) and len(line.images) < len(CAMERAS):
            line.images[_camera(part, len(line.images))] = re.split(r"[/\\]", part)[-1]
            rest = index + 1
        elif line.images and _is_number(part):
            break
    blanks = len(CAMERAS) - len(line.images)  # cells of cameras that this log does not have
    while line.images and blanks and rest < len(record) and not record[rest]:
        rest, blanks = rest + 1, blanks - 1
    line.fields = list(record[rest:])
    return line


def _camera(path: str, position: int) -> str:
    name = re.split(r"[/\\]", path)[-1].lower()
    return next((camera for camera in CAMERAS if name.startswith(camera)), CAMERAS[position])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def time_of(name: str) -> float:
    """Seconds (of an arbitrary day zero) in a picture's name, `..._2016_12_01_13_30_48_287.jpg`; NaN if none."""
    stamp = TIME_STAMP.search(name)
    if stamp is None:
        return math.nan
    *date, milliseconds = map(int, stamp.groups())
    try:
        return (datetime(*date) - datetime(1970, 1, 1)).total_seconds() + milliseconds / 1000  # type: ignore[arg-type]
    except ValueError:
        return math.nan


# Writing


def time_stamp(moment: datetime) -> str:
    """The time in a picture's name, to the millisecond: `2016_12_01_13_30_48_287`; `time_of` reads it."""
    return f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}"


def format_line(images: Sequence[str], steering: float, throttle: float, speed: float) -> str:
    """A line of the log, with its end.

    Args:
        images: names or paths of the centre, left and right picture; "" for one that there is not.
        steering: -1..1.
        throttle: -1..1; a negative one is written as brake.
        speed: mph.
    """
    values = (steering, max(0.0, throttle), max(0.0, -throttle), abs(speed))  # in this order: never -0
    return ",".join([*images, *(f"{value:.7g}" for value in values)]) + "\n"


# Decimal commas


def _has_decimal_commas(lines: Sequence[LogLine], columns: int) -> bool:
    """Whether numbers were cut in two: never a point, and a row that holds more numbers than columns."""
    runs = [_whole_numbers(line.fields) for line in lines]
    pointed = any(re.match(r"-?\d*\.\d", part) for line in lines for part in line.fields[:columns])
    return not pointed and any(len(run) > columns for run in runs)


def _whole_numbers(fields: Sequence[str]) -> list[str]:
    return list(itertools.takewhile(WHOLE_NUMBER.fullmatch, fields))


def _join_decimal_commas(lines: Sequence[LogLine], columns: Sequence[str]) -> None:
    """Give every line the reading in which the values change least from row to row (Viterbi)."""
    readable = [(line, readings) for line in lines if (readings := _readings(line.fields, columns))]
    if not readable:
        return
    costs, origins = [0.0] * len(readable[0][1]), []
    for (_, before), (_, now) in itertools.pairwise(readable):
        steps = [[cost + _jump(old, new) for cost, old in zip(costs, before, strict=True)] for new in now]
        origins.append([step.index(min(step)) for step in steps])
        costs = [min(step) for step in steps]
    choice = costs.index(min(costs))
    for (line, readings), origin in zip(reversed(readable), [*reversed(origins), []], strict=True):
        line.values = readings[choice]
        choice = origin[choice] if origin else 0


def _readings(fields: Sequence[str], columns: Sequence[str]) -> list[dict[str, str]]:
    """All plausible ways to join whole numbers into one value a column."""
    parts = _whole_numbers(fields)
    fractions = len(parts) - len(columns)
    readings = []
    for cut in itertools.combinations(range(len(columns)), max(fractions, 0)):
        source = iter(parts)
        values = [
            f"{part}.{next(source)}" if index in cut else part
            for index, part in zip(range(len(columns)), source, strict=False)
        ]
        reading = dict(zip(columns, values, strict=False))
        if len(values) == len(columns) and all(itertools.starmap(_plausible, reading.items())):
            readings.append(reading)
    return readings


def _plausible(name: str, value: str) -> bool:
    """Whether the simulator would write this: in range, no '1.0', '-0', '0.-5' or '012'."""
    written = re.fullmatch(r"-?(0|[1-9]\d*)(\.\d*[1-9]|(\.\d+)?E[+-]?\d+)?", value, re.IGNORECASE)
    low, high = RANGES.get(name, (float("-inf"), float("inf")))
    return written is not None and value != "-0" and low <= float(value) <= high


def _jump(old: dict[str, str], new: dict[str, str]) -> float:
    return sum(abs(float(new[name]) - float(old[name])) / scale for name, scale in SCALES.items() if name in new)
