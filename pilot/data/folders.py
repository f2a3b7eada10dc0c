"""The folders in data/: recordings by a person, corrections of a model, and the built-in simulator's demonstrations."""

from collections.abc import Collection
from pathlib import Path

from pilot.data.log_format import LOG_NAME
from pilot.data.steered_by import STEERED_BY

DATA = Path("data")
BUILT_IN = "built_in"  # demonstrations
SEQUENCES = "built_in_sequences"  # more of them, for networks that see earlier frames or predict what comes later
DEMONSTRATIONS = (BUILT_IN, SEQUENCES)


def has_own_recordings(folder: Path) -> bool:
    """Return whether a folder contains recordings other than demonstrations, and corrections of a model."""
    logs = (log for log in folder.rglob(LOG_NAME) if not (log.parent / STEERED_BY).exists())
    demonstrations = {folder / name for name in DEMONSTRATIONS}
    return any(demonstrations.isdisjoint(log.parents) for log in logs)


def with_demonstrations(folder: Path, names: Collection[str]) -> tuple[Path, ...]:
    """Return the folders to learn from in one without own recordings: those demonstrations, and all corrections."""
    others = {folder / other for other in DEMONSTRATIONS if other not in names}
    return tuple(sorted(each for each in folder.iterdir() if each not in others and any(each.rglob(LOG_NAME))))
