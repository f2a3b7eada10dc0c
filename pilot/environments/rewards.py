"""Reward of a step: progress along the road, less penalties for leaving the lane's middle and for jerky steering."""

from pilot.simulator.episode import CarState
from pilot.vehicle import MPH, TOP_SPEED_MPH

CROSS_TRACK_WEIGHT = 0.1  # per m²
LARGEST_CROSS_TRACK_PENALTY = 0.4  # less than the reward for progress at 15 mph: driving on is always worth it
STEERING_CHANGE_WEIGHT = 0.5  # per squared change of the steering (-1..1) from step to step


def reward(before: CarState, after: CarState) -> float:
    """Return the reward of a step between two states; at most 1: at top speed, in the lane's middle, without steering.

    The progress is divided by the distance at top speed in the same time. It is negative when driving backwards.
    """
    seconds = after.time - before.time
    progress = (after.progress - before.progress) / (TOP_SPEED_MPH * MPH * seconds)
    beside = min(CROSS_TRACK_WEIGHT * after.cross_track_error**2, LARGEST_CROSS_TRACK_PENALTY)
    jerk = STEERING_CHANGE_WEIGHT * (after.steering - before.steering) ** 2
    return progress - beside - jerk
