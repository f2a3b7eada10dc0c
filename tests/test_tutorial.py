"""The commands of docs/tutorial.md, one after another (minutes; `--long` runs it)."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY

BLOCK = re.compile(r"(?P<before>[^\n]*)\n```bash\n(?P<lines>.*?)```", re.DOTALL)
LEFT_OUT = "<!-- not executed by the tests -->"


def commands() -> list[list[str]]:
    """The commands that are executed."""
    text = (REPOSITORY / "docs" / "tutorial.md").read_text(encoding="utf-8")
    blocks = [block["lines"] for block in BLOCK.finditer(text) if block["before"] != LEFT_OUT]
    words = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    assert all(line[0] == "python" for line in words)
    return [[sys.executable, str(REPOSITORY / line[1]), *line[2:]] for line in words]


def interventions(scores: Path) -> dict[str, dict[str, int]]:
    """Interventions by model and track."""
    evaluations = json.loads(scores.read_text())["evaluations"]
    return {each["model"]: {row["title"]: row["interventions"] for row in each["rows"]} for each in evaluations}


@pytest.mark.long
def test_the_tutorial_does_what_it_says(tmp_path: Path) -> None:
    for command in commands():
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=900)
        assert done.returncode == 0, done.stderr
        print(done.stdout)
    before = interventions(tmp_path / "before" / "scores.json")["first"]
    after = interventions(tmp_path / "after" / "scores.json")
    assert after["first"] == before
    assert before["lake"] == 0
    assert after["improved"]["random:12"] < before["random:12"]
    assert after["improved"]["lake"] == 0
