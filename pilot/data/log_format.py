"""Parsing and writing of driving_log.csv, as written by any version of the simulator.

A line contains the names of up to three images, followed by numbers. Everything else varies: header, separators,
absolute paths of other computers (which may contain commas), columns added by a spreadsheet, and decimal commas that
split a number into two fields.
"""

import csv
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path

from pilot.vehicle import CAMERAS, PLAUSIBLE_SPEED_MPH

LOG_NAME = "driving_log.csv"
NUMBERS = ("steering", "throttle", "brake", "speed")
STEERING_NAMES = {"steering_angle": "steering", "angle": "steering", "steer": "steering"}

# Plausible values, used to distinguish decimal commas from separators.
RANGES = {"steering": (-1.0, 1.0), "throttle": (0.0, 1.0), "brake": (0.0, 1.0), "speed": (0.0, PLAUSIBLE_SPEED_MPH)}
# Divisors that make the changes of the values from row to row comparable.
SCALES = {"steering": 1.0, "throttle": 1.0, "brake": 1.0, "speed": 3.0}

SAMPLE = 2000  # characters at the beginning from which the separator is recognised

TIME_STAMP = re.compile(r"(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d{3})")
IMAGE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp")
WHOLE_NUMBER = re.compile(r"-?\d+(E[+-]?\d+)?", re.IGNORECASE)


@dataclass(slots=True)
class LogLine:
    """One line of a log.

    Attributes:
        number: line number in the file, from 1.
        images: file names by camera; only those that the line contains.
        values: numbers as text, by name; only those that the line contains.
        fields: all fields after the images.
    """

    number: int
    images: dict[str, str] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)
    fields: list[str] = field(default_factory=list)


def read_log(log: Path) -> Iterator[LogLine]:
    """Parse a driving_log.csv, line by line: a log may be longer than the memory.

    Yields:
        The lines, except the header and those without content.

    Raises:
        OSError: the file cannot be read.
        ValueError: the header has no steering column after the images.
    """
    with log.open(encoding="utf-8-sig", errors="replace") as file:
        yield from parse_log(file)


def parse_log(lines: Iterable[str]) -> Iterator[LogLine]:
    """Parse the lines of a log, as `read_log` does."""
    records = _split(lines)
    columns = list(NUMBERS)
    if first := next(records, None):
        header = _header(first[1])
        columns = header or columns
        records = records if header else itertools.chain([first], records)
    parsed = (_parse_record(number, record) for number, record in records)
    parsed = (line for line in parsed if line.images or line.fields)
    held = list(_until_point(parsed, len(columns)))  # usually one line: most logs have decimal points in each
    if _has_decimal_commas(held, len(columns)):
        _join_decimal_commas(held, columns)
        yield from held
    else:
        for line in itertools.chain(held, parsed):
            line.values = dict(zip(columns, line.fields, strict=False))
            yield line


def _split(lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the stripped fields of each non-empty line."""
    parts = (part for line in lines for part in line.replace("\0", "").splitlines())
    head = list(itertools.islice(parts, SAMPLE))
    sample = "\n".join(head)[:SAMPLE]
    separator = next((mark for mark in ";\t" if sample.count(mark) > sample.count(",")), ",")
    for number, line in enumerate(itertools.chain(head, parts), start=1):
        record = [part.strip() for part in _fields(line, separator)]
        if separator != "," or '"' in line:  # here, a comma within a field is a decimal comma
            record = [re.sub(r"^(-?\d+),(\d+)", r"\1.\2", part) for part in record]
        if any(record):
            yield number, record


def _fields(line: str, separator: str) -> list[str]:
    if '"' in line and len(line) <= csv.field_size_limit():
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return line.split(separator)


def _header(record: Sequence[str]) -> list[str]:
    """Return the names of the columns after the images if the record is a header, else an empty list."""
    names = [STEERING_NAMES.get(name.lower(), name.lower()) for name in record]
    if not set(names) & {*CAMERAS, *NUMBERS} or any(name.endswith(IMAGE_ENDINGS) for name in names):
        return []
    last_camera = max((index for index, name in enumerate(names) if name in CAMERAS), default=-1)
    if "steering" not in names[last_camera + 1 :]:
        raise ValueError(f"the header ({', '.join(record)}) names no 'steering' column after the images")
    return names[last_camera + 1 :]


def _parse_record(number: int, record: Sequence[str]) -> LogLine:
    line = LogLine(number)
    rest = 0
    for index, part in enumerate(record):
        if part.lower().endswith(IMAGE_ENDINGS) and len(line.images) < len(CAMERAS):
            name = part.replace("\\", "/").rpartition("/")[2]
            line.images[_camera(name, len(line.images))] = name
            rest = index + 1
        elif line.images and _is_number(part):
            break
    blanks = len(CAMERAS) - len(line.images)  # empty cells of cameras missing in this log
    while line.images and blanks and rest < len(record) and not record[rest]:
        rest, blanks = rest + 1, blanks - 1
    line.fields = list(record[rest:])
    return line


def _camera(name: str, position: int) -> str:
    lower = name.lower()
    for camera in CAMERAS:
        if lower.startswith(camera):
            return camera
    return CAMERAS[position]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def time_of(name: str) -> float:
    """Return the time in an image's name, `..._2016_12_01_13_30_48_287.jpg`, in seconds since 1970; NaN if none."""
    stamp = TIME_STAMP.search(name)
    if stamp is None:
        return math.nan
    year, month, day, hour, minute, second, milliseconds = map(int, stamp.groups())
    if hour > 23 or minute > 59 or second > 59:
        return math.nan
    return _midnight(year, month, day) + 3600 * hour + 60 * minute + second + milliseconds / 1000


@lru_cache
def _midnight(year: int, month: int, day: int) -> float:
    """Return the beginning of a day in seconds since 1970; NaN if there is no such day."""
    try:
        return (datetime(year, month, day) - datetime(1970, 1, 1)).total_seconds()
    except ValueError:
        return math.nan


# Writing


def time_stamp(moment: datetime) -> str:
    """Format a time for an image's name, `2016_12_01_13_30_48_287` (milliseconds last); `time_of` parses it."""
    return f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}"


def format_line(images: Sequence[str], steering: float, throttle: float, speed: float) -> str:
    """Format a line of the log, including the line break.

    Args:
        images: names or paths of the centre, left and right images; "" for a missing one.
        steering: -1..1.
        throttle: -1..1; negative values are written as brake.
        speed: mph; its absolute value is written.
    """
    values = (steering, max(0.0, throttle), max(0.0, -throttle), abs(speed))  # max in this order never gives -0
    return ",".join([*images, *(f"{value:.7g}" for value in values)]) + "\n"


# Decimal commas


def _until_point(lines: Iterable[LogLine], columns: int) -> Iterator[LogLine]:
    """Yield the lines up to the first one with a decimal point."""
    for line in lines:
        yield line
        if _has_point(line, columns):
            break


def _has_point(line: LogLine, columns: int) -> bool:
    return any(re.match(r"-?\d*\.\d", part) for part in line.fields[:columns])


def _has_decimal_commas(lines: Sequence[LogLine], columns: int) -> bool:
    """Return whether commas split numbers: there are no decimal points, and a row has more numbers than columns."""
    runs = [_whole_numbers(line.fields) for line in lines]
    return not any(_has_point(line, columns) for line in lines) and any(len(run) > columns for run in runs)


def _whole_numbers(fields: Sequence[str]) -> list[str]:
    return list(itertools.takewhile(WHOLE_NUMBER.fullmatch, fields))


def _join_decimal_commas(lines: Sequence[LogLine], columns: Sequence[str]) -> None:
    """Choose among the readings of each line such that values change least between rows (Viterbi algorithm)."""
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
    """Return all plausible readings of a line: ways to join its whole numbers into one value per column."""
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
    """Return whether the simulator could have written a value: in range, and not '1.0', '-0', '0.-5' or '012'."""
    written = re.fullmatch(r"-?(0|[1-9]\d*)(\.\d*[1-9]|(\.\d+)?E[+-]?\d+)?", value, re.IGNORECASE)
    low, high = RANGES.get(name, (float("-inf"), float("inf")))
    return written is not None and value != "-0" and low <= float(value) <= high


def _jump(old: dict[str, str], new: dict[str, str]) -> float:
    return sum(abs(float(new[name]) - float(old[name])) / scale for name, scale in SCALES.items() if name in new)
