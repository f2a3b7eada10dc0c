"""Steps per second of the Gymnasium environments, of one alone and of one per core: python benchmarks/environments.py.

The car follows the expert's steering, recorded before, so that it sees the road and the steering takes no time. The
best of some rounds counts, because other programs only make it slower.
"""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

import pilot.environments  # noqa: F401 - registers the environments
from pilot.environments.driving_env import STEP_SECONDS, DrivingEnv
from pilot.environments.registration import environment_ids
from pilot.simulator.expert import Expert

STEPS = {"state": 4000, "image": 500}
RESETS = 3
SEED = 0
Actions = NDArray[np.float32]


def experts_actions(name: str, steps: int) -> Actions:
    """Return the expert's steering (steps x 1) in the first episode of an environment."""
    env = gymnasium.make(name, observations="state", laps=100.0).unwrapped
    assert isinstance(env, DrivingEnv)
    env.reset(seed=SEED)
    expert = Expert(env.simulator.episode)
    actions = []
    for _ in range(steps):
        actions.append(np.array([expert.command()[0]], np.float32))
        env.step(actions[-1])
    return np.stack(actions)


def alone(name: str, kind: str, actions: Actions) -> tuple[float, float]:
    """Return the steps of one environment per second of processor time, and the seconds of a reset."""
    env = gymnasium.make(name, observations=kind, laps=100.0)
    env.reset(seed=SEED)
    began = time.process_time()
    ends = [env.step(action)[2:4] for action in actions]
    speed = len(actions) / (time.process_time() - began)
    assert ends == [(False, False)] * len(actions)
    began = time.perf_counter()
    for _ in range(RESETS):
        env.reset()
    resetting = (time.perf_counter() - began) / RESETS
    env.close()
    return speed, resetting


def together(name: str, kind: str, actions: Actions, number: int) -> float:
    """Return the steps per second of environments in one process each, all of them together."""
    options: dict[str, Any] = {"observations": kind, "laps": 100.0}
    envs = gymnasium.make_vec(name, number, "async", vector_kwargs={"context": "spawn"}, **options)
    assert isinstance(envs, AsyncVectorEnv)
    envs.reset(seed=[SEED] * number)
    began = time.perf_counter()
    for action in actions:
        envs.step(np.repeat(action[None], number, axis=0))
    speed = number * len(actions) / (time.perf_counter() - began)
    envs.close()
    return speed


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1, help="environments at the same time")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--envs", nargs="+", default=list(environment_ids()), help="ids")
    options = parser.parse_args()
    cores, rounds = options.cores, range(options.rounds)
    print(f"| environment | observations | steps/s a core | times real time | reset, s | {cores} at once, steps/s |")
    print("|---|---|---:|---:|---:|---:|")
    for name in options.envs:
        for kind, steps in STEPS.items():
            actions = experts_actions(name, steps)
            measured = np.array([alone(name, kind, actions) for _ in rounds])
            speed, resetting = measured[:, 0].max(), measured[:, 1].min()
            both = max(together(name, kind, actions, cores) for _ in rounds)
            print(
                f"| {name} | {kind} | {speed:,.0f} | {speed * STEP_SECONDS:,.0f} | {resetting:.3f} | {both:,.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
