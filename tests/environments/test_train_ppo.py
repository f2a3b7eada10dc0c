"""The example that trains PPO, with a budget too small to learn anything."""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import REPOSITORY

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("stable_baselines3") is None, reason="stable-baselines3 is not installed"
)
Example = Callable[..., int]


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Example:
    """Run the example with options, in an empty folder; returns its exit code."""
    monkeypatch.syspath_prepend(REPOSITORY / "examples")
    monkeypatch.chdir(tmp_path)

    def run(*options: str) -> int:
        from train_ppo import main

        monkeypatch.setattr(sys, "argv", ["train_ppo.py", *options])
        return main()

    return run


def test_trains_saves_the_policy_and_drives_with_it(example: Example, capsys: pytest.CaptureFixture[str]) -> None:
    assert example("--steps", "1", "--envs", "2", "--env", "pilot/Mountain-v0") == 0
    assert capsys.readouterr().out.startswith("1024 steps in ")
    assert example("--policy", "ppo.zip", "--env", "pilot/Random-v0", "--drives", "2") == 0
    assert "pilot/Random-v0: 0 of 2 drives are whole laps" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--envs", "0"], "--envs 0: must be at least 1"),
        (["--policy", "none.zip"], "--policy none.zip: there is no such file"),
        (["--speed", "99"], "speed=99.0: must lie in 1..30 mph"),
    ],
)
def test_says_what_is_wrong(
    example: Example, capsys: pytest.CaptureFixture[str], options: list[str], named: str
) -> None:
    assert example(*options) == 1
    assert named in capsys.readouterr().err
