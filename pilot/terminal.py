"""Text for the terminal: what comes from files and the network can neither control it nor flood it.

A log, a file name or a server's answer may contain escape sequences, which change the terminal, or overrides of the
writing direction, which show something else than what is there. They are made visible where text is printed, not where
it enters, because error messages carry it along from everywhere.
"""

import logging
from typing import TextIO

LONGEST = 2000  # characters of a message
SHOWN_OF_END = 500  # of these, the last ones: the end of an error message says what to do


def printable(text: object) -> str:
    r"""Return a message as a single line without control characters, cut in the middle if it is very long.

    Messages have one line, so that a line break is from outside, and would let a file name begin a line of its own. It
    is escaped like all characters that show nothing or steer the terminal: \n, \x1b, \u202e.
    """
    message = str(text)
    if len(message) <= LONGEST:
        return _escaped(message)
    begin, end = message[: LONGEST - SHOWN_OF_END], message[-SHOWN_OF_END:]
    return f"{_escaped(begin)} [... {len(message) - LONGEST} characters left out ...] {_escaped(end)}"


def show(text: str, file: TextIO | None = None) -> None:
    """Print a text of this program that may contain names from outside; its line breaks remain.

    Args:
        text: a table or several lines; not cut, because a name is never long.
        file: where to print it; None: standard output.
    """
    print(*map(_escaped, text.split("\n")), sep="\n", file=file, flush=True)


def _escaped(text: str) -> str:
    return text if text.isprintable() else "".join(c if c.isprintable() else _escape(c) for c in text)


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode()


class PrintableFormatter(logging.Formatter):
    """Formats log messages as single printable lines; only a traceback keeps its lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the name in logging
        """Return the line of a message."""
        record.message = printable(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: object) -> str:  # noqa: N802 - the name in logging
        """Return the lines of a traceback."""
        return "\n".join(map(printable, super().formatException(ei).split("\n")))  # type: ignore[arg-type]
