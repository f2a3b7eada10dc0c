"""Rows → samples: cameras, leak-free split, label smoothing, balance.

A sample is a picture with the steering that a network shall learn for it. Samples are a table with
the columns: image (path), camera, steering (label), recorded (what the driver did, of the moment's
centre picture), moment (number), recording, time (s), speed (mph), weight (in the loss, mean 1),
flip and rotation (degrees): an augmentation that is the sample's own, for copies made once.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from pilot.arrays import Floats
from pilot.data.driving_log import part_of_each
from pilot.data.segments import segment_numbers
from pilot.vehicle import CAMERAS

Generator = np.random.Generator

SHORTEST_BLOCK = 0.1  # seconds; blocks of a short recording are shortened until there are enough to choose from
SPIKE_FACTOR = 0.85  # report 004: no spike above this share of the largest ordinary value's count
SPIKE_WIDTH = 0.01  # steering values closer than this count as one value
SPIKE_SHARE = 0.05  # a value is a spike when more than this share of all samples has it


@dataclass(frozen=True)
class SampleConfig:
    """Which samples are made of the rows."""

    cameras: Literal["all", "center"] = "all"
    """Pictures of all three cameras, or of the middle one only."""
    side_rule: Literal["constant", "geometric"] = "constant"
    """Steering of the side cameras' pictures: a constant correction, or report 004's arctan(tan(a) +- 1/4)."""
    side_correction: float = 0.2
    """The constant correction: added for the left camera, taken off for the right one (-1..1)."""
    smooth_seconds: float = 0.0
    """Average the recorded steering over this time (for keyboard drivers, who steer in jerks); 0: as recorded."""
    balance: Literal["none", "drop-zeros", "spikes", "cap", "weight"] = "none"
    """How an excess of equal steering (mostly 0) is evened out: see docs/training.md."""
    drop_zeros: float = 0.9
    """For balance=drop-zeros: share of the moments with zero steering to drop."""
    bins: int = 25
    """For balance=cap and weight: bins of the steering histogram over -1..1."""
    cap: float = 2.0
    """For balance=cap: no bin may hold more than this many times the mean of the filled bins."""
    split: Literal["blocks", "recordings", "moments"] = "blocks"
    """Validation by contiguous blocks of time (neighbouring frames are near copies), by whole recordings (is it
    good on a drive it has not seen?), or by single moments, as the students did."""
    validation_share: float = 0.2
    """Share of the moments kept for validation."""
    block_seconds: float = 10.0
    """For split=blocks: length of a block."""
    first_part: float = 1.0
    """Learn only from this first share of each recording; to replay the rest: evaluate.py --last-part."""
    min_speed: float = 1.0
    """Leave out moments slower than this (mph): a parked car's steering teaches nothing."""
    flipped_copies: bool = False
    """Add a mirrored copy of every training picture (instead of mirroring at random)."""
    rotated_copies: int = 0
    """Add this many copies of every training picture, each turned by an angle drawn once."""
    rotation_range: float = 45.0
    """For rotated copies: angles are drawn from -range..range degrees."""


def make_samples(rows: pd.DataFrame, config: SampleConfig, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Turn the rows of a driving log into samples for training and for validation.

    Everything taken at one moment is on one side. Validation holds the centre pictures with the
    steering as it was recorded; only balance=spikes balances it too, as report 004 does.

    Raises:
        ValueError: too few rows for a training and a validation set.
    """
    rng = np.random.default_rng(seed)
    rows = part_of_each(rows, 0, config.first_part)
    rows = rows[~(rows["speed"] < config.min_speed)].reset_index(drop=True)
    validating = split_rows(rows, config, rng)
    moments = rows.assign(moment=rows.index, recorded=rows["steering"])
    validation = camera_samples(moments[validating], SampleConfig(cameras="center"))
    moments["steering"] = smooth_steering(rows, config.smooth_seconds)
    if config.balance == "drop-zeros":
        moments = moments[~_surplus_zeros(moments["recorded"], config.drop_zeros, rng) | validating]
    training = camera_samples(moments[~validating.reindex(moments.index)], config)
    if config.balance == "spikes":
        validation = drop_spikes(validation, rng)
    return add_copies(balance(training, config, rng), config, rng), validation


# Split


def split_rows(rows: pd.DataFrame, config: SampleConfig, rng: Generator) -> "pd.Series[bool]":
    """True for the rows of the validation set; about `validation_share` of them.

    With split=blocks every recording is cut into blocks of time, and of each handful of neighbouring
    blocks one is drawn, so that validation comes from all parts of the drive. With split=recordings the
    share is that of the recordings, of however many rows they are.

    Raises:
        ValueError: one of the two sets would be empty.
    """
    if config.split == "blocks":
        validating = _validation_blocks(rows, config, rng)
    else:
        validating = _validation_groups(rows, config, rng)
    if len(rows) == 0 or validating.all() or not validating.any():
        raise ValueError(
            f"{len(rows)} moments faster than {config.min_speed} mph are too few to keep a validation set apart: "
            "record more laps"
        )
    return validating


def _validation_blocks(rows: pd.DataFrame, config: SampleConfig, rng: Generator) -> "pd.Series[bool]":
    handful = max(round(1 / config.validation_share), 2)
    driven = rows.groupby(segment_numbers(rows))["time"].agg(lambda time: time.max() - time.min()).sum()
    blocks = block_numbers(rows, min(config.block_seconds, max(driven, SHORTEST_BLOCK) / handful))
    chosen = []
    for _, numbers in blocks.groupby(rows["recording"]):
        unique = numbers.unique()
        starts = range(0, len(unique) - handful // 2, handful)
        chosen += [rng.choice(unique[start : start + handful]) for start in starts]
    return blocks.isin(chosen)


def _validation_groups(rows: pd.DataFrame, config: SampleConfig, rng: Generator) -> "pd.Series[bool]":
    from sklearn.model_selection import GroupShuffleSplit  # noqa: PLC0415 - takes a second, and is seldom wanted

    groups = rows["recording"] if config.split == "recordings" else rows.index.to_series()
    if config.split == "recordings" and groups.nunique() == 1:
        raise ValueError(
            "--samples.split recordings keeps whole recordings for validation, and there is only one: "
            "name more with --data, or use --samples.split blocks"
        )
    splitter = GroupShuffleSplit(1, test_size=config.validation_share, random_state=int(rng.integers(2**31)))
    chosen = next(splitter.split(rows, groups=groups))[1] if len(rows) > 1 else []
    return pd.Series(rows.index.isin(chosen), index=rows.index)


def block_numbers(rows: pd.DataFrame, seconds: float) -> "pd.Series[int]":
    """Number of the block of time (one recording, one stretch without a gap) that each row is in."""
    segment = segment_numbers(rows)
    since_start = rows["time"] - rows.groupby(segment)["time"].transform("min")
    return pd.Series(pd.MultiIndex.from_arrays([segment, since_start // seconds]).factorize()[0], index=rows.index)


# Labels


def smooth_steering(rows: pd.DataFrame, seconds: float) -> "pd.Series[float]":
    """Centred moving average of the recorded steering over a time, never across a gap or two recordings."""
    if seconds <= 0 or rows.empty:
        return rows["steering"]
    parts = [_moving_average(segment, seconds) for _, segment in rows.groupby(segment_numbers(rows))]
    return pd.Series(np.concatenate(parts), index=rows.index)


def _moving_average(segment: pd.DataFrame, seconds: float) -> Floats:
    time, steering = segment["time"].to_numpy(), segment["steering"].to_numpy()
    sums = np.concatenate([[0.0], np.cumsum(steering)])
    first = np.searchsorted(time, time - seconds / 2 - 1e-6)
    last = np.searchsorted(time, time + seconds / 2 + 1e-6)
    return np.asarray((sums[last] - sums[first]) / (last - first))


def side_steering(steering: float, camera: str, config: SampleConfig) -> float:
    """The steering (-1..1) to learn for a camera's picture, when the driver steered `steering`.

    The left camera sees what a car too far left would see, so its picture asks for more right.
    The geometric rule is report 004's: bring the camera, 1 m aside, back to the middle 4 m ahead. It
    takes the number -1..1 for an angle in radians, as the report does: its histogram has its spikes at
    +-0.245 = arctan(1/4). (By the car's true scale of 25 degrees that would be +-0.56, too strong.)
    """
    sign = {"center": 0.0, "left": 1.0, "right": -1.0}[camera]
    if config.side_rule == "geometric":
        return math.atan(math.tan(steering) + sign / 4)
    return steering + sign * config.side_correction


def camera_samples(moments: pd.DataFrame, config: SampleConfig) -> pd.DataFrame:
    """One sample for every picture of the moments, with its camera's steering."""
    cameras = CAMERAS if config.cameras == "all" else CAMERAS[:1]
    parts = []
    for camera in cameras:
        part = moments[moments[camera] != ""]
        labels = [side_steering(steering, camera, config) for steering in part["steering"]]
        kept = part[["recorded", "moment", "recording", "time", "speed"]]
        parts.append(kept.assign(image=part[camera], camera=camera, steering=labels))
    samples = pd.concat(parts, ignore_index=True)
    return samples.assign(weight=1.0, flip=False, rotation=0.0)


# Balance


def balance(samples: pd.DataFrame, config: SampleConfig, rng: Generator) -> pd.DataFrame:
    """Even out the steering histogram of training samples as `config.balance` says."""
    if config.balance == "spikes":
        return drop_spikes(samples, rng)
    if config.balance == "cap":
        return cap_histogram(samples, config.bins, config.cap, rng)
    if config.balance == "weight":
        return weigh(samples, config.bins)
    return samples


def _surplus_zeros(steering: "pd.Series[float]", share: float, rng: Generator) -> "pd.Series[bool]":
    """Report 002: mark a share of the moments whose steering is exactly zero."""
    return (steering == 0) & (rng.random(len(steering)) < share)


def drop_spikes(samples: pd.DataFrame, rng: Generator) -> pd.DataFrame:
    """Report 004: take out the over-represented steering values and mix only a sample of them back in.

    Together the spikes come back as 0.85 x their number x the count of the most frequent ordinary value.
    """
    values = (samples["steering"] / SPIKE_WIDTH).round()
    counts = values.value_counts()
    spikes = counts.index[counts > SPIKE_SHARE * len(samples)]
    ordinary = counts.drop(spikes)
    if len(spikes) == 0 or ordinary.empty:
        return samples
    skewed = samples.index[values.isin(spikes)].to_numpy()
    size = min(int(SPIKE_FACTOR * len(spikes) * ordinary.max()), len(skewed))
    back = rng.choice(skewed, size, replace=False)
    return samples[~values.isin(spikes) | samples.index.isin(back)].reset_index(drop=True)


def cap_histogram(samples: pd.DataFrame, bins: int, cap: float, rng: Generator) -> pd.DataFrame:
    """Drop samples at random until no bin holds more than `cap` times the mean of the filled bins."""
    shuffled = samples.iloc[rng.permutation(len(samples))]
    bin_of = _bins(shuffled["steering"], bins)
    limit = max(int(cap * bin_of.value_counts().mean()), 1)
    kept = shuffled[shuffled.groupby(bin_of).cumcount() < limit]
    return kept.sort_index().reset_index(drop=True)


def weigh(samples: pd.DataFrame, bins: int) -> pd.DataFrame:
    """Weigh each sample by one over the root of its bin's count: rare steering counts more, mean 1."""
    bin_of = _bins(samples["steering"], bins)
    weight = 1 / np.sqrt(bin_of.map(bin_of.value_counts()))
    return samples.assign(weight=weight / weight.mean())


def _bins(steering: "pd.Series[float]", bins: int) -> "pd.Series[int]":
    return ((steering.clip(-1, 1) + 1) / 2 * bins).astype(int).clip(0, bins - 1)


# Copies


def add_copies(samples: pd.DataFrame, config: SampleConfig, rng: Generator) -> pd.DataFrame:
    """Reports 000 and 002: mirrored and rotated copies of every training picture, made once.

    A copy is a row that says how its picture is changed; the label is changed with the picture.
    """
    if config.flipped_copies:
        samples = pd.concat([samples, samples.assign(flip=True)], ignore_index=True)
    angles = rng.uniform(-config.rotation_range, config.rotation_range, (config.rotated_copies, len(samples)))
    copies = [samples.assign(rotation=rotation) for rotation in angles]
    return pd.concat([samples, *copies], ignore_index=True)
