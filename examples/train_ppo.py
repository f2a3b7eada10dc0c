"""Trains PPO until its policy drives a whole lap: python examples/train_ppo.py; needs stable-baselines3.

python examples/train_ppo.py                                            # learns on the lake, saves ppo.zip
python examples/train_ppo.py --policy ppo.zip --env pilot/Mountain-v0    # drives another road with that policy

J. Schulman et al., Proximal Policy Optimization Algorithms (2017), arXiv 1707.06347.
"""

import functools
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
import torch
import tyro
from gymnasium.wrappers import ResizeObservation
from tqdm import tqdm

try:
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.utils import LinearSchedule
    from stable_baselines3.common.vec_env import SubprocVecEnv, VecEnv
except ModuleNotFoundError as error:
    raise SystemExit(f"{error}: this example needs pip install stable-baselines3==2.9.2") from None

sys.path.insert(0, str(Path(__file__).parents[1]))

import pilot.environments  # noqa: F401 - registers the environments
from pilot import cli
from pilot.arrays import Floats
from pilot.interrupt import Interrupt, catch_interrupt

ROLLOUT = 512  # steps of each environment between two updates
UPDATES_PER_DRIVE = 2
PRACTICE, TEST = 1000, 2000  # first seeds of the drives that end a training, and of those with a saved policy


@dataclass(frozen=True)
class TrainConfig:
    """Options of the training."""

    env: str = "pilot/Lake-v0"
    """Environment to train and drive in."""
    observations: Literal["state", "image"] = "state"
    """What the policy sees: the car's state, or the camera's image, which takes minutes instead of seconds."""
    speed: float = 20.0
    """Target speed in mph."""
    seed: int = 0
    """Of the policy's weights, its exploration and the start positions."""
    drives: int = 1
    """Drives in a row that have to be whole laps; in Random-v0, each is on another road."""
    envs: int = 8
    """Number of cars that drive at the same time."""
    steps: int = 1_000_000
    """Largest number of steps of 40 ms, of all cars together."""
    policy: Path | None = None
    """A saved policy, to drive with instead of training."""
    out: Path = Path("ppo.zip")
    """File to save the policy in."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is out of range.
        """
        for name in ("envs", "steps", "drives"):
            if getattr(self, name) < 1:
                raise ValueError(f"--{name} {getattr(self, name)}: must be at least 1")
        if self.policy is not None and not self.policy.is_file():
            raise ValueError(f"--policy {self.policy}: there is no such file; train one without this option")


@dataclass(frozen=True)
class Drive:
    """One drive of a policy without exploration, from the start line.

    Attributes:
        completed: whether it drove the whole lap without leaving the road.
        laps: how far it came, 0..1.
        seconds: simulated time.
        errors: cross-track errors of all steps, metres.
        steering: of all steps, -1..1.
    """

    completed: bool
    laps: float
    seconds: float
    errors: Floats
    steering: Floats


def drive(policy: PPO, env: gymnasium.Env[Any, Any], seed: int) -> Drive:
    """Drive from the start line until the lap is complete or the episode ends."""
    observation, info = env.reset(seed=seed)
    infos = [info]
    ended = False
    while not ended:
        action, _ = policy.predict(observation, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        infos.append(info)
        ended = terminated or truncated
    errors, steering = (np.array([info[key] for info in infos]) for key in ("cross_track_error", "steering"))
    return Drive(info["completed"], min(info["laps"], 1.0), info["time"], errors, steering)


def describe(drives: Sequence[Drive]) -> str:
    """Return a sentence about drives."""
    errors = np.abs(np.concatenate([each.errors for each in drives]))
    changes = np.abs(np.concatenate([np.diff(each.steering) for each in drives]))
    laps, seconds = (np.mean([getattr(each, name) for each in drives]) for name in ("laps", "seconds"))
    return (
        f"{sum(each.completed for each in drives)} of {len(drives)} drives are whole laps; "
        f"{laps:.0%} of a lap in {seconds:.0f} s on average; "
        f"cross-track error: mean {errors.mean():.2f}, largest {errors.max():.2f} m; "
        f"steering change per step: mean {changes.mean():.3f}"
    )


class UntilItDrives(BaseCallback):
    """Ends the training when all drives in a row are whole laps, or on Ctrl-C.

    Attributes:
        drives: the last ones, until the first that left the road.
    """

    def __init__(self, config: TrainConfig, interrupt: Interrupt, bar: "tqdm[Any]") -> None:
        super().__init__()
        self._env, self._number, self._interrupt, self._bar = car(config), config.drives, interrupt, bar
        self._updates = 0
        self.drives: list[Drive] = []

    def _on_step(self) -> bool:
        self._bar.update(self.training_env.num_envs)
        return not self._interrupt.asked and sum(each.completed for each in self.drives) < self._number

    def _on_rollout_start(self) -> None:
        if self._updates % UPDATES_PER_DRIVE == 0 and self._updates:
            self.drives = []
            for number in range(self._number):
                self.drives.append(drive(self.model, self._env, PRACTICE + number))  # type: ignore[arg-type]
                self._bar.set_postfix_str(f"drive {number + 1}: {self.drives[-1].laps:.0%} of a lap")
                if self._interrupt.asked or not self.drives[-1].completed:
                    break
        self._updates += 1


def as_seen(env: gymnasium.Env[Any, Any], config: TrainConfig) -> gymnasium.Env[Any, Any]:
    """Reduce images to a quarter of their size, 40x80x3: the network would be slow otherwise."""
    return ResizeObservation(env, (40, 80)) if config.observations == "image" else env


def car(config: TrainConfig, **options: Any) -> gymnasium.Env[Any, Any]:
    """Return an environment in which the policy can drive."""
    return as_seen(gymnasium.make(config.env, observations=config.observations, speed=config.speed, **options), config)


def car_of_a_worker(config: TrainConfig) -> gymnasium.Env[Any, Any]:
    """Return an environment to learn in, in a process that leaves Ctrl-C to its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return car(config, random_start=True)


def cars(config: TrainConfig) -> VecEnv:
    """Return the environments to learn in: in one process, or one process each if images are to be rendered."""
    if config.observations == "state":
        return make_vec_env(functools.partial(car, config, random_start=True), config.envs, config.seed)
    return make_vec_env(functools.partial(car_of_a_worker, config), config.envs, config.seed, vec_env_cls=SubprocVecEnv)


def new_policy(config: TrainConfig, envs: VecEnv) -> PPO:
    """Return an untrained policy: two layers of 64 units for the state vector, a small CNN for images."""
    kind = "MlpPolicy" if config.observations == "state" else "CnnPolicy"
    return PPO(
        kind,
        envs,
        learning_rate=LinearSchedule(1e-3, 1e-4, 1.0),
        n_steps=ROLLOUT,
        batch_size=512,
        n_epochs=10,
        gamma=0.98,
        gae_lambda=0.95,
        policy_kwargs={"log_std_init": -1.5},
        seed=config.seed,
        device="cpu",
    )


def train(config: TrainConfig) -> None:
    """Train, and save the policy.

    Raises:
        KeyboardInterrupt: Ctrl-C; the policy so far is saved.
    """
    torch.set_num_threads(1)  # the networks are too small to share their work
    began = time.monotonic()
    with closing(cars(config)) as envs, catch_interrupt() as interrupt:
        bar = tqdm(total=config.steps, unit=" steps", leave=False)
        until = UntilItDrives(config, interrupt, bar)
        policy = new_policy(config, envs).learn(config.steps, until)
        bar.close()
    policy.save(config.out)
    seconds, processor = time.monotonic() - began, time.process_time()
    print(f"{policy.num_timesteps} steps in {seconds:.0f} s ({processor:.0f} s of processor time of this process)")
    print(describe(until.drives) if until.drives else "no drive yet")
    if interrupt.asked:
        raise KeyboardInterrupt(f"the policy so far is in {config.out}")
    print(f"policy: {config.out}")


def main() -> int:
    """Train, or drive with a saved policy; returns the exit code."""
    config = tyro.cli(TrainConfig, description=__doc__)

    def action() -> None:
        config.check()
        if config.policy is None:
            train(config)
        else:
            policy, env = PPO.load(config.policy, device="cpu"), car(config)
            seeds = range(TEST + config.seed, TEST + config.seed + config.drives)
            print(f"{config.env}: {describe([drive(policy, env, seed) for seed in seeds])}")

    return cli.run("train_ppo.py", action)


if __name__ == "__main__":
    sys.exit(main())
