import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pilot.data.samples import (
    SampleConfig,
    block_numbers,
    cap_histogram,
    drop_spikes,
    make_samples,
    side_steering,
    smooth_steering,
    weigh,
)


def drive(count: int = 600, recording: int = 0, steering: np.ndarray | None = None) -> pd.DataFrame:
    """Rows of a driving log, 10 a second."""
    number = np.arange(count)
    values = np.round(np.sin(number / 9) * 0.5, 3) if steering is None else steering
    return pd.DataFrame(
        {
            "recording": recording,
            "line": number,
            "time": number * 0.1,
            "center": [f"c{recording}_{i}" for i in number],
            "left": [f"l{recording}_{i}" for i in number],
            "right": [f"r{recording}_{i}" for i in number],
            "steering": values,
            "throttle": 1.0,
            "brake": 0.0,
            "speed": 20.0,
            "correction": False,
        }
    )


def keyboard(count: int = 3000) -> np.ndarray:
    """Mostly zero, as keyboard drivers steer."""
    rng = np.random.default_rng(0)
    return np.where(rng.random(count) < 0.7, 0.0, rng.normal(0, 0.3, count).clip(-1, 1))


def samples_of(rows: pd.DataFrame, **options: object) -> tuple[pd.DataFrame, pd.DataFrame]:
    return make_samples(rows, SampleConfig(**options), seed=0)


@pytest.mark.parametrize("split", ["blocks", "moments"])
def test_a_moment_is_on_one_side_only(split: str) -> None:
    rows = pd.concat([drive(), drive(recording=1)], ignore_index=True)
    training, validation = samples_of(rows, split=split, flipped_copies=True, rotated_copies=2)
    assert not set(training["moment"]) & set(validation["moment"])
    assert 0.15 < len(set(validation["moment"])) / len(rows) < 0.25


def test_whole_recordings_can_be_kept_for_validation() -> None:
    rows = pd.concat([drive(100 * (1 + number), recording=number) for number in range(5)], ignore_index=True)
    training, validation = samples_of(rows, split="recordings")
    assert training["recording"].nunique() == 4
    assert validation["recording"].nunique() == 1
    assert not set(training["recording"]) & set(validation["recording"])


def test_a_single_recording_cannot_be_split_by_recordings() -> None:
    with pytest.raises(ValueError, match=r"--samples.split recordings .* only one: name more with --data"):
        samples_of(drive(), split="recordings")


@pytest.mark.parametrize("share", [0.1, 0.2, 0.5, 0.7, 0.9])
def test_validation_has_the_share_that_was_asked_for(share: float) -> None:
    _, validation = samples_of(drive(3000), validation_share=share)
    assert len(validation) / 3000 == pytest.approx(share, abs=0.07)


def test_only_the_first_part_of_each_recording_is_learned_from() -> None:
    rows = pd.concat([drive(300), drive(200, recording=1)], ignore_index=True)
    training, validation = samples_of(rows, first_part=0.8)
    used = {*training["image"], *validation["image"]}
    assert {f"c0_{i}" for i in range(240)} | {f"c1_{i}" for i in range(160)} <= used
    assert not used & ({f"c0_{i}" for i in range(240, 300)} | {f"c1_{i}" for i in range(160, 200)})


def test_blocks_keep_neighbouring_frames_together() -> None:
    training, validation = samples_of(drive(2000), split="blocks", block_seconds=10)
    moments = np.sort(validation["moment"])
    assert np.sum(np.diff(moments) > 1) < len(moments) / 50  # few borders
    trained = set(training["moment"])
    near = [moment for moment in moments if moment - 1 in trained or moment + 1 in trained]
    assert len(near) < len(moments) / 20


def test_blocks_end_at_gaps_and_recordings() -> None:
    rows = pd.concat([drive(50), drive(50, recording=1)], ignore_index=True)
    rows.loc[25:, "time"] += 100
    assert block_numbers(rows, 1000).nunique() == 3


def test_validation_is_never_augmented() -> None:
    _, validation = samples_of(drive(), flipped_copies=True, rotated_copies=3, smooth_seconds=1.0)
    assert set(validation["camera"]) == {"center"}
    assert not validation["flip"].any()
    assert (validation["rotation"] == 0).all()
    assert (validation["steering"] == validation["recorded"]).all()


def test_side_cameras_steer_towards_the_middle() -> None:
    training, _ = samples_of(drive(), side_correction=0.2)
    by_camera = training.set_index(["moment", "camera"])["steering"].unstack()
    np.testing.assert_allclose(by_camera["left"] - by_camera["center"], 0.2)
    np.testing.assert_allclose(by_camera["right"] - by_camera["center"], -0.2)


def test_corrections_weigh_more_than_other_time_steps() -> None:
    rows = drive().assign(correction=lambda rows: rows.index >= 500)
    training, validation = samples_of(rows, correction_weight=4, block_seconds=1)
    weights = training.groupby(training["moment"] >= 500)["weight"].unique()
    assert weights[True] == pytest.approx(4 * weights[False])
    assert training["weight"].mean() == pytest.approx(1)
    assert (validation["moment"] >= 500).any()
    assert (validation["weight"] == 1).all()


def test_geometric_rule_is_that_of_report_004() -> None:
    config = SampleConfig(side_rule="geometric")
    assert side_steering(0.0, "left", config) == pytest.approx(0.245, abs=1e-3)
    assert side_steering(0.3, "right", config) == pytest.approx(math.atan(math.tan(0.3) - 0.25))
    assert side_steering(0.3, "center", config) == pytest.approx(0.3)


def test_missing_side_pictures_make_no_samples() -> None:
    rows = drive()
    rows["left"] = ""
    training, _ = samples_of(rows)
    assert set(training["camera"]) == {"center", "right"}


def test_drop_zeros_drops_that_share_of_training_only() -> None:
    rows = drive(3000, steering=keyboard())
    config = SampleConfig(balance="drop-zeros", drop_zeros=0.9, cameras="center")
    before, validation_before = make_samples(rows, replace(config, balance="none"), seed=0)
    after, validation_after = make_samples(rows, config, seed=0)
    zeros = (before["recorded"] == 0).sum()
    assert 0.06 * zeros < (after["recorded"] == 0).sum() < 0.14 * zeros
    assert (after["recorded"] != 0).sum() == (before["recorded"] != 0).sum()
    assert len(validation_after) == len(validation_before)


def test_spikes_come_back_as_often_as_the_largest_ordinary_value() -> None:
    rng = np.random.default_rng(0)
    ordinary = rng.integers(-60, 60, 1000) / 100
    samples = pd.DataFrame({"steering": np.concatenate([np.zeros(800), np.full(700, 0.25), ordinary])})
    result = drop_spikes(samples, rng)
    values = (result["steering"] * 100).round()
    spikes = values.isin([0, 25]).sum()
    assert spikes == pytest.approx(0.85 * 2 * values[~values.isin([0, 25])].value_counts().max(), abs=2)
    assert (~values.isin([0, 25])).sum() == (~(samples["steering"] * 100).round().isin([0, 25])).sum()


def test_spikes_balance_validation_too() -> None:
    rows = drive(3000, steering=keyboard())
    _, plain = samples_of(rows)
    _, balanced = samples_of(rows, balance="spikes")
    assert (balanced["recorded"] == 0).sum() < (plain["recorded"] == 0).sum() / 3


def test_cap_flattens_the_histogram() -> None:
    samples = pd.DataFrame({"steering": keyboard()})
    counts = np.histogram(cap_histogram(samples, 25, 1.0, np.random.default_rng(0))["steering"], 25, (-1, 1))[0]
    before = np.histogram(samples["steering"], 25, (-1, 1))[0]
    assert counts.max() <= before[before > 0].mean()
    assert (counts > 0).sum() == (before > 0).sum()


def test_weights_favour_rare_steering_and_have_mean_one() -> None:
    samples = weigh(pd.DataFrame({"steering": keyboard(), "weight": 1.0}), 25)
    assert samples["weight"].mean() == pytest.approx(1)
    rare, common = samples["steering"].abs() > 0.5, samples["steering"] == 0
    assert samples["weight"][rare].min() > 2 * samples["weight"][common].max()


def test_smoothing_averages_over_time_but_not_across_gaps() -> None:
    rows = drive(40, steering=np.where(np.arange(40) < 20, 0.0, 1.0))
    smooth = smooth_steering(rows, 0.5)
    assert smooth[20] == pytest.approx(0.6)
    assert smooth[[0, 39]].tolist() == [0, 1]
    rows.loc[20:, "time"] += 60
    assert smooth_steering(rows, 0.5).tolist() == rows["steering"].tolist()


def test_parked_moments_teach_nothing() -> None:
    rows = drive()
    rows.loc[:99, "speed"] = 0.1
    training, validation = samples_of(rows)
    assert len({*training["center" if "center" in training else "image"]} & {f"c0_{i}" for i in range(100)}) == 0
    assert training["moment"].nunique() + len(validation) == 500
    rows["speed"] = np.nan  # a log without speeds: all count as moving
    assert sum(part["moment"].nunique() for part in samples_of(rows)) == 600


def test_copies_are_mirrored_and_rotated_rows() -> None:
    plain, _ = samples_of(drive())
    copies, _ = samples_of(drive(), flipped_copies=True, rotated_copies=6, rotation_range=45)
    assert len(copies) == len(plain) * 2 * 7
    assert copies["flip"].mean() == 0.5
    rotated = copies[copies["rotation"] != 0]
    assert len(rotated) == len(plain) * 2 * 6
    assert rotated["rotation"].between(-45, 45).all()


def test_same_seed_same_samples() -> None:
    rows = drive(3000, steering=keyboard())
    first, second = (make_samples(rows, SampleConfig(balance="drop-zeros"), seed=3)[0] for _ in range(2))
    pd.testing.assert_frame_equal(first, second)


def test_too_few_rows_for_two_sets_is_an_error() -> None:
    with pytest.raises(ValueError, match="too few to split off a validation set"):
        samples_of(drive(1))


def test_a_short_recording_is_split_into_shorter_blocks() -> None:
    training, validation = samples_of(drive(12))
    assert 1 <= len(validation) <= 5
    assert training["moment"].nunique() + len(validation) == 12
