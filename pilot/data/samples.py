"""Rows to samples: split without leakage, label smoothing, side cameras, balancing, copies.

A sample is an image with its label. A table of samples has the columns: image (path), camera, steering (the label),
recorded (the recorded steering), moment (number of the time step), recording, time (s), speed (mph), weight (in the
loss, mean 1 over the training samples), flip and rotation (degrees; fixed augmentations of copies that are made once).

For networks that see or predict more (`pilot.signature`), there are more columns: "image -0.2 s" (earlier images),
"steering +0.1 s" (labels of later steering) and "speed ahead" (label in mph); labels are NaN where nobody knows them.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from pilot.arrays import Floats
from pilot.data.driving_log import share_of_each
from pilot.data.motion import path_steering
from pilot.data.other_times import (
    image_columns,
    label_columns,
    require_labels,
    steering_columns,
    with_other_times,
)
from pilot.data.segments import segment_numbers
from pilot.pursuit import EXPERT, PurePursuit
from pilot.signature import STEERING_ONLY, Signature
from pilot.vehicle import (
    CAMERA_OFFSETS,
    CAMERAS,
    MPH,
    SIDE_CAMERA_OFFSET,
    curvature_to_steering,
    steering_to_curvature,
)

Generator = np.random.Generator

SHORTEST_BLOCK = 0.1  # seconds; blocks of short recordings are shortened, down to this, until there are enough of them
SPIKE_FACTOR = 0.85  # report 004: mean count of the reduced spikes, relative to the most frequent ordinary value
SPIKE_WIDTH = 0.01  # width of the bins in which steering values count as equal
SPIKE_SHARE = 0.05  # a value is a spike if it has more than this share of all samples


@dataclass(frozen=True)
class SampleConfig:
    """Options for the conversion of rows to samples."""

    cameras: Literal["all", "center"] = "all"
    """Use the images of all three cameras, or of the centre camera only."""
    side_rule: Literal["constant", "geometric", "pursuit"] = "constant"
    """Labels of the side cameras' images: a constant correction, report 004's arctan(tan(steering) +- 1/4), or the
    built-in expert's law."""
    side_correction: float = 0.2
    """For side-rule=constant: added to the steering for the left camera, subtracted for the right one (-1..1)."""
    smooth_seconds: float = 0.0
    """Seconds over which the recorded steering is averaged (for jerky keyboard driving); 0: not averaged."""
    path_metres: float = 0.0
    """Metres of the driven path ahead to whose end the label leads (pure pursuit): where the car went, instead of
    which key was pressed; 0: the recorded steering is the label."""
    balance: Literal["none", "drop-zeros", "spikes", "cap", "weight"] = "none"
    """Method of balancing the steering histogram, in which 0 is usually too frequent: see docs/training.md."""
    drop_zeros: float = 0.9
    """For balance=drop-zeros: share (0..1) of the time steps with zero steering to drop."""
    bins: int = 25
    """For balance=cap and weight: number of bins of the steering histogram over -1..1."""
    cap: float = 2.0
    """For balance=cap: largest count of a bin, as a multiple of the mean count of the non-empty bins."""
    correction_weight: float = 4.0
    """Weight in the loss of the time steps in which a person or the expert corrects a model, relative to the others:
    they are few, and show what it does wrong."""
    split: Literal["blocks", "recordings", "moments"] = "blocks"
    """Units of the train/validation split: contiguous blocks of time (because neighbouring frames are near
    duplicates), whole recordings (to validate on unseen ones), or single time steps as in the students' reports."""
    validation_share: float = 0.2
    """Share (0..1) of the time steps used for validation; of the recordings, for split=recordings."""
    block_seconds: float = 10.0
    """For split=blocks: length of a block in seconds."""
    first_part: float = 1.0
    """Use only this first share (0..1) of each recording; evaluate.py --last-part replays the rest."""
    min_speed: float = 1.0
    """Leave out time steps slower than this (mph), such as those of a parked car."""
    flipped_copies: bool = False
    """Add a mirrored copy of each training image (an alternative to random mirroring)."""
    rotated_copies: int = 0
    """Number of copies to add of each training image, each rotated by a random angle that is drawn once."""
    rotation_range: float = 45.0
    """For rotated copies: largest rotation in degrees, in either direction."""


def make_samples(
    rows: pd.DataFrame, config: SampleConfig, seed: int, signature: Signature = STEERING_ONLY
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Convert the rows of driving logs to training samples and validation samples.

    All images of one time step are in the same set. The validation set contains the centre images with the recorded
    steering; it is balanced only by balance=spikes, as in report 004.

    Args:
        rows: table of rows as in `DrivingLog.rows`.
        config: options for the conversion to samples.
        seed: seed of the split, the balancing and the copies.
        signature: what the network sees and predicts.

    Returns:
        The tables of the training samples and of the validation samples.

    Raises:
        ValueError: there are too few rows, or recordings, for a training and a validation set, or no row has a label
            of an output of the network.
    """
    rng = np.random.default_rng(seed)
    rows = share_of_each(rows, 0, config.first_part)
    rows = rows[~(rows["speed"] < config.min_speed)].reset_index(drop=True)
    in_validation = split_rows(rows, config, rng)
    moments = rows.assign(moment=rows.index, recorded=rows["steering"])
    if config.path_metres:
        moments["steering"] = path_steering(rows, config.path_metres)
    moments["steering"] = smooth_steering(moments, config.smooth_seconds)
    moments = with_other_times(moments, signature)
    as_recorded = moments[in_validation].assign(steering=moments["recorded"])
    validation = camera_samples(as_recorded, SampleConfig(cameras="center", correction_weight=1), signature)
    if config.balance == "drop-zeros":
        moments = moments[~_surplus_zeros(moments["recorded"], config.drop_zeros, rng) | in_validation]
    training = camera_samples(moments[~in_validation.reindex(moments.index)], config, signature)
    require_labels(training, signature)
    if config.balance == "spikes":
        validation = drop_spikes(validation, rng)
    return add_copies(balance(training, config, rng), config, rng), validation


# Split


def split_rows(rows: pd.DataFrame, config: SampleConfig, rng: Generator) -> "pd.Series[bool]":
    """Mark the rows of the validation set, about `validation_share` of them.

    With split=blocks, each recording is cut into blocks of time, and one of every 1 / `validation_share` consecutive
    blocks (at least 2, so at most about half of the rows) is drawn, so that the validation set covers the whole
    recording. With split=recordings, `validation_share` is the share of the recordings, regardless of their lengths.

    Raises:
        ValueError: one of the two sets would be empty.
    """
    if config.split == "blocks":
        in_validation = _validation_blocks(rows, config, rng)
    else:
        in_validation = _validation_groups(rows, config, rng)
    if len(rows) == 0 or in_validation.all() or not in_validation.any():
        raise ValueError(
            f"{len(rows)} time steps faster than {config.min_speed} mph are too few to split off a validation set: "
            "record more laps"
        )
    return in_validation


def _validation_blocks(rows: pd.DataFrame, config: SampleConfig, rng: Generator) -> "pd.Series[bool]":
    share = config.validation_share
    handful = max(round(1 / min(share, 1 - share)), 2)
    driven = rows.groupby(segment_numbers(rows))["time"].agg(lambda time: time.max() - time.min()).sum()
    blocks = block_numbers(rows, min(config.block_seconds, max(driven, SHORTEST_BLOCK) / handful))
    chosen = []
    for _, numbers in blocks.groupby(rows["recording"]):
        unique = numbers.unique()
        starts = range(0, len(unique) - handful // 2, handful)
        chosen += [rng.choice(unique[start : start + handful]) for start in starts]
    return blocks.isin(chosen) if share <= 1 / 2 else ~blocks.isin(chosen)


def _validation_groups(rows: pd.DataFrame, config: SampleConfig, rng: Generator) -> "pd.Series[bool]":
    from sklearn.model_selection import GroupShuffleSplit  # noqa: PLC0415 - takes a second and is seldom needed

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
    """Return the number of each row's block: up to `seconds` of one segment."""
    segment = segment_numbers(rows)
    since_start = rows["time"] - rows.groupby(segment)["time"].transform("min")
    return rows.groupby([segment, since_start // seconds], sort=False).ngroup()


# Labels


def smooth_steering(rows: pd.DataFrame, seconds: float) -> "pd.Series[float]":
    """Return the centred moving average of the recorded steering over `seconds`, within each segment."""
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


def side_steering(
    steering: float | Floats, camera: str, config: SampleConfig, metres: float | Floats = 0.0
) -> float | Floats:
    """Return the label of a camera's image, or n labels, for the driver's steering (-1..1).

    That of a later steering is for a car that has already driven some `metres` of its way back.

    The left camera sees what the centre camera of a car too far left would see, so its label is further right. The
    geometric rule is that of report 004: a camera 1 m to the side returns to the middle within 4 m. Like the report, it
    treats the steering as an angle in radians: the report's histogram has spikes at +-0.245 = arctan(1/4). (With the
    car's true scale, 25 degrees at 1, they would be at +-0.56, which is too strong.)
    """
    sign = {"center": 0.0, "left": 1.0, "right": -1.0}[camera]
    if config.side_rule == "geometric":
        return np.asarray(np.arctan(np.tan(steering) + sign / 4))
    if config.side_rule == "pursuit":
        curvature = steering_to_curvature(np.asarray(steering, float))
        there = EXPERT.after(metres, CAMERA_OFFSETS[camera], 0.0)
        return curvature_to_steering(EXPERT.curvature(curvature, *there))
    return steering + sign * config.side_correction * _correction_left(config.side_correction, metres)


def _correction_left(correction: float, metres: float | Floats) -> float | Floats:
    """Return the share of the correction of a side camera that is left after some metres.

    The correction steers for the point of the path at which it would arrive if it were kept.
    """
    if not np.any(metres) or correction <= 0:
        return 1.0
    lookahead = math.sqrt(2 * SIDE_CAMERA_OFFSET / float(steering_to_curvature(correction)))
    law = PurePursuit(lookahead, 0.0)
    there = law.after(metres, SIDE_CAMERA_OFFSET, 0.0)
    return law.curvature(0.0, *there) / law.curvature(0.0, SIDE_CAMERA_OFFSET, 0.0)


def camera_samples(moments: pd.DataFrame, config: SampleConfig, signature: Signature = STEERING_ONLY) -> pd.DataFrame:
    """Return one sample for each image of the time steps, with the labels for its camera."""
    cameras = CAMERAS if config.cameras == "all" else CAMERAS[:1]
    parts = []
    for camera in cameras:
        part = moments[moments[camera] != ""]
        kept = part[["recorded", "moment", "recording", "time", "speed", *label_columns(signature)]]
        images = {
            name: part[of_camera]
            for name, of_camera in zip(image_columns(signature), image_columns(signature, camera), strict=True)
        }
        category = pd.Series(camera, part.index, pd.CategoricalDtype(list(CAMERAS)))  # takes a byte per sample
        weight: Floats = np.where(part["correction"], config.correction_weight, 1.0)
        labels = _camera_labels(part, camera, config, signature)
        parts.append(kept.assign(**images, camera=category, weight=weight, **labels))
    samples = pd.concat(parts, ignore_index=True)
    return samples.assign(weight=samples["weight"] / samples["weight"].mean(), flip=False, rotation=0.0)


def _camera_labels(
    part: pd.DataFrame, camera: str, config: SampleConfig, signature: Signature
) -> dict[str, float | Floats]:
    metres_per_second = part["speed"].fillna(0).to_numpy(float) * MPH
    return {
        name: side_steering(part[name].to_numpy(float), camera, config, seconds * metres_per_second)
        for name, seconds in zip(steering_columns(signature), signature.horizons, strict=True)
    }


# Balancing


def balance(samples: pd.DataFrame, config: SampleConfig, rng: Generator) -> pd.DataFrame:
    """Balance training samples by the method `config.balance`."""
    if config.balance == "spikes":
        return drop_spikes(samples, rng)
    if config.balance == "cap":
        return cap_histogram(samples, config.bins, config.cap, rng)
    if config.balance == "weight":
        return weigh(samples, config.bins)
    return samples


def _surplus_zeros(steering: "pd.Series[float]", share: float, rng: Generator) -> "pd.Series[bool]":
    """Mark a random share (0..1) of the time steps whose steering is exactly zero (report 002)."""
    return (steering == 0) & (rng.random(len(steering)) < share)


def drop_spikes(samples: pd.DataFrame, rng: Generator) -> pd.DataFrame:
    """Reduce over-represented steering values, the spikes, to a random subset of their samples (report 004).

    The subset's size is 0.85 x the number of spikes x the count of the most frequent ordinary value.
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
    """Drop random samples until no bin holds more than `cap` times the mean count of the non-empty bins."""
    shuffled = samples.iloc[rng.permutation(len(samples))]
    bin_of = _bins(shuffled["steering"], bins)
    limit = max(int(cap * bin_of.value_counts().mean()), 1)
    kept = shuffled[shuffled.groupby(bin_of).cumcount() < limit]
    return kept.sort_index().reset_index(drop=True)


def weigh(samples: pd.DataFrame, bins: int) -> pd.DataFrame:
    """Divide each sample's weight by the square root of its bin's count; normalised to a mean of 1."""
    bin_of = _bins(samples["steering"], bins)
    weight = samples["weight"].to_numpy(float) / np.sqrt(bin_of.map(bin_of.value_counts()).to_numpy(float))
    return samples.assign(weight=weight / weight.mean())


def _bins(steering: "pd.Series[float]", bins: int) -> "pd.Series[int]":
    return ((steering.clip(-1, 1) + 1) / 2 * bins).astype(int).clip(0, bins - 1)


# Copies


def add_copies(samples: pd.DataFrame, config: SampleConfig, rng: Generator) -> pd.DataFrame:
    """Add mirrored and rotated copies of each sample, drawn once for the whole training (reports 000 and 002).

    A copy is a row whose `flip` and `rotation` describe the change; the label is changed when the image is loaded.
    """
    if config.flipped_copies:
        samples = pd.concat([samples, samples.assign(flip=True)], ignore_index=True)
    angles = rng.uniform(-config.rotation_range, config.rotation_range, (config.rotated_copies, len(samples)))
    copies = [samples.assign(rotation=rotation) for rotation in angles]
    return pd.concat([samples, *copies], ignore_index=True)
