"""The quick attacks with files and on what is kept; report.py runs them all."""

import sys
from pathlib import Path

import pytest

if sys.platform == "win32":
    pytest.skip("pipes, limits and kills are those of POSIX", allow_module_level=True)

import file_attacks
import power_attacks
from file_attacks import FileAttack

QUICK = [
    file_attacks.crafted_models,
    file_attacks.image_bombs,
    file_attacks.pipes_and_links,
    file_attacks.escapes_in_logs,
    file_attacks.wrong_options,
    file_attacks.foreign_folders,
    power_attacks.power_cuts_in_training,
    power_attacks.killed_writers,
    power_attacks.full_disks,
]


@pytest.mark.parametrize("attack", QUICK, ids=lambda attack: attack.__name__)
def test_nothing_gets_through(attack: FileAttack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    finding = attack(tmp_path)
    assert finding.tries > 0
    assert finding.through == 0
