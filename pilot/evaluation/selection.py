"""Short driving checks during training, by which the best epoch is selected."""

import functools

import numpy as np
import pandas as pd

from pilot.driving.driver import DrivingCheck
from pilot.driving.plan import SteeringPolicy
from pilot.evaluation.closed_loop import drive_laps
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.replay import Replayable, prepare, replay
from pilot.simulator.simulator import Simulator
from pilot.simulator.trajectory import Trajectory

# tracks that no demonstration contains; the start position of each has a different seed
ROADS = tuple(f"random:{seed}" for seed in range(2000, 2006))
SHORT = Conditions(laps=0.2)


def driving_check() -> DrivingCheck:
    """Return a check that drives a part of each of several random tracks.

    It returns the number of interventions and the mean absolute cross-track error in metres.
    """
    simulator = Simulator()

    def check(steer: SteeringPolicy) -> tuple[int, float]:
        return _sum_up([_drive(simulator, road, number, steer) for number, road in enumerate(ROADS)])

    return check


def _drive(simulator: Simulator, road: str, start: int, steer: SteeringPolicy) -> Trajectory:
    simulator.reset(road, start)
    return drive_laps(simulator.episode, lambda _: simulator.look()["center"], steer, SHORT)


def replay_check(rows: pd.DataFrame) -> DrivingCheck:
    """Return a check that replays the rows of a driving log.

    It returns the number of interventions and the mean absolute cross-track error in metres.

    Raises:
        UnusableRecording: the rows cannot be replayed.
        UnreadableImage: an image cannot be read.
    """
    return functools.partial(_replay, prepare(rows))


def _replay(recording: Replayable, steer: SteeringPolicy) -> tuple[int, float]:
    return _sum_up(replay(recording, steer))


def _sum_up(trajectories: list[Trajectory]) -> tuple[int, float]:
    errors = np.concatenate([each.cross_track_errors for each in trajectories])
    return sum(len(each.interventions) for each in trajectories), float(np.abs(errors).mean())
