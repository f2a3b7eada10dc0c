"""The rooms lie on floors: what docs/architecture.md draws, checked on the import lines."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import pilot

PACKAGE = Path(pilot.__file__).parent
# from the ground up; "" are the files beside the folders
FLOORS = ["", "data", "model", "portable", "driving", "video", "exchange", "simulator", "environments", "evaluation"]
FLOORS += ["training", "board", "inspection", "commands"]


def room_of(file: Path) -> str:
    return "" if file.parent == PACKAGE else file.relative_to(PACKAGE).parts[0]


def imported_rooms(file: Path) -> Iterator[tuple[int, str]]:
    """Line and room of each import of this package, those inside functions too."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "pilot":
            modules = [f"{node.module}.{name.name}" for name in node.names]
        elif isinstance(node, ast.Import):
            modules = [name.name for name in node.names if name.name.split(".")[0] == "pilot"]
        else:
            continue
        for module in modules:
            part = module.split(".")[1]
            yield node.lineno, part if (PACKAGE / part).is_dir() else ""


def test_every_folder_has_a_floor() -> None:
    folders = {folder.parent.relative_to(PACKAGE).parts[0] for folder in PACKAGE.glob("*/__init__.py")}
    assert folders == set(FLOORS[1:])


@pytest.mark.parametrize("room", FLOORS)
def test_no_room_imports_one_above_it(room: str) -> None:
    files = [file for file in PACKAGE.rglob("*.py") if room_of(file) == room]
    assert files
    upwards = [
        f"{file.relative_to(PACKAGE)}:{line} imports {imported}"
        for file in files
        for line, imported in imported_rooms(file)
        if FLOORS.index(imported) > FLOORS.index(room)
    ]
    assert upwards == []


def test_tests_lie_as_the_package_lies() -> None:
    tests = Path(__file__).parent
    for file in tests.rglob("test_*.py"):
        folder = file.parent.relative_to(tests)
        if folder == Path("hostile"):  # attacks on the whole program
            continue
        assert (PACKAGE / folder).is_dir(), f"{file}: there is no pilot/{folder}"
