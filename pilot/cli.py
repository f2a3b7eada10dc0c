"""What all commands have in common: how errors, Ctrl-C and log messages reach the terminal, and exit codes."""

import logging
import sys
from collections.abc import Callable
from pathlib import Path

INTERRUPTED = 130  # exit code of a program that Ctrl-C has ended, as shells know it


def program(script: str) -> str:
    """How the user has called this command: as `script` in a clone, or as an installed command."""
    called = Path(sys.argv[0]).stem
    return called if called.startswith("pilot-") else script


def run(name: str, action: Callable[[], None], *, talkative: bool = False) -> int:
    """Do what a command does, and turn what goes wrong into one sentence.

    Args:
        name: of the command, in front of its error.
        action: parses options, checks them, does the work; raises ValueError, OSError or RuntimeError with the cure in
            the message, and KeyboardInterrupt, which may say what became of the work.
        talkative: show what the package logs at level INFO, such as who connects.

    Returns:
        the exit code: 0, 1 after an error, 130 after Ctrl-C.
    """
    logging.basicConfig(level=logging.ERROR, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    if talkative:
        logging.getLogger("pilot").setLevel(logging.INFO)
    try:
        action()
    except KeyboardInterrupt as interrupt:
        print(f"\nInterrupted{f': {interrupt}' if str(interrupt) else ''}.", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError, RuntimeError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    return 0
