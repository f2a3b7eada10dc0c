"""How well a network drives in the middle of its training: short checks, to choose the epoch by."""

import functools

import numpy as np
import pandas as pd

from pilot.driving.driver import Steer
from pilot.evaluation.closed_loop import drive_laps
from pilot.evaluation.plan import Setup
from pilot.evaluation.replay import Replayable, prepare, replay
from pilot.evaluation.scores import Trajectory
from pilot.simulator.simulator import Simulator
from pilot.training.trainer import DrivingCheck

# roads that are in no demonstration; another seed of the start place for each
ROADS = tuple(f"random:{seed}" for seed in range(2000, 2006))
SHORT = Setup(laps=0.2)


def driving_check() -> DrivingCheck:
    """Drives a part of each of some built-in roads: interventions, and mean offset in metres."""
    simulator = Simulator()

    def check(steer: Steer) -> tuple[int, float]:
        return _sum_up([_drive(simulator, road, number, steer) for number, road in enumerate(ROADS)])

    return check


def _drive(simulator: Simulator, road: str, start: int, steer: Steer) -> Trajectory:
    simulator.reset(road, start)
    return drive_laps(simulator.episode, lambda _: simulator.look()["center"], steer, SHORT)


def replay_check(rows: pd.DataFrame) -> DrivingCheck:
    """Replays rows of a log: interventions, and mean offset in metres.

    Raises:
        UnusableRecording: they cannot be replayed.
    """
    return functools.partial(_replay, prepare(rows))


def _replay(recording: Replayable, steer: Steer) -> tuple[int, float]:
    return _sum_up(replay(recording, steer))


def _sum_up(trajectories: list[Trajectory]) -> tuple[int, float]:
    offsets = np.concatenate([episode.offsets for episode in trajectories])
    return sum(len(episode.interventions) for episode in trajectories), float(np.abs(offsets).mean())
