"""How well a network drives in the middle of its training: short checks, to choose the epoch by."""

import functools

import numpy as np
import pandas as pd

from pilot.driving.driver import DrivingCheck, SteeringPolicy
from pilot.evaluation.closed_loop import drive_laps
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.replay import Replayable, prepare, replay
from pilot.simulator.simulator import Simulator
from pilot.simulator.trajectory import Trajectory

# roads that are in no demonstration; another seed of the start place for each
ROADS = tuple(f"random:{seed}" for seed in range(2000, 2006))
SHORT = Conditions(laps=0.2)


def driving_check() -> DrivingCheck:
    """Drives a part of each of some built-in roads: interventions, and mean cross-track error in metres."""
    simulator = Simulator()

    def check(steer: SteeringPolicy) -> tuple[int, float]:
        return _sum_up([_drive(simulator, road, number, steer) for number, road in enumerate(ROADS)])

    return check


def _drive(simulator: Simulator, road: str, start: int, steer: SteeringPolicy) -> Trajectory:
    simulator.reset(road, start)
    return drive_laps(simulator.episode, lambda _: simulator.look()["center"], steer, SHORT)


def replay_check(rows: pd.DataFrame) -> DrivingCheck:
    """Replays rows of a log: interventions, and mean cross-track error in metres.

    Raises:
        UnusableRecording: they cannot be replayed.
    """
    return functools.partial(_replay, prepare(rows))


def _replay(recording: Replayable, steer: SteeringPolicy) -> tuple[int, float]:
    return _sum_up(replay(recording, steer))


def _sum_up(trajectories: list[Trajectory]) -> tuple[int, float]:
    errors = np.concatenate([each.cross_track_errors for each in trajectories])
    return sum(len(each.interventions) for each in trajectories), float(np.abs(errors).mean())
