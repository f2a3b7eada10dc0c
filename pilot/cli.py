"""Common behaviour of all commands: error messages, Ctrl-C, log messages and exit codes."""

import logging
import socket
import sys
from collections.abc import Callable
from pathlib import Path

from pilot.terminal import PrintableFormatter, printable

INTERRUPTED = 130  # exit code after Ctrl-C by the convention of shells: 128 + SIGINT


def program(script: str) -> str:
    """Return the name by which the user called this command: `script` in a clone, or that of the installed command."""
    called = Path(sys.argv[0]).stem
    return called if called.startswith("pilot-") else script


def run(name: str, action: Callable[[], None], *, verbose: bool = False) -> int:
    """Run a command and turn exceptions into one-line error messages and exit codes.

    Args:
        name: name of the command, printed before an error message.
        action: function that parses and checks the options and executes the command. It may raise ValueError, OSError
            or RuntimeError with a message that tells the user what to do, or KeyboardInterrupt, optionally with a
            message about the state in which it stopped.
        verbose: show the package's log messages of level INFO, such as new connections.

    Returns:
        The exit code: 0 on success, 1 after an error, 130 after Ctrl-C.
    """
    handler = logging.StreamHandler()
    handler.setFormatter(PrintableFormatter("%(asctime)s %(message)s", "%H:%M:%S"))
    logging.basicConfig(level=logging.ERROR, handlers=[handler])
    if verbose:
        logging.getLogger("pilot").setLevel(logging.INFO)
    try:
        action()
    except KeyboardInterrupt as interrupt:
        print(f"\nInterrupted{f': {printable(interrupt)}' if str(interrupt) else ''}.", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the program that read the output has ended, such as head
        sys.stdout = None  # nothing is written to it any more, not even at the exit
        return 1
    except (ValueError, OSError, RuntimeError) as error:
        print(f"{name}: {printable(error)}", file=sys.stderr)
        return 1
    return 0


def check_address(host: str, port: int) -> None:
    """Check the options --host and --port.

    Raises:
        ValueError: there is no such host or port; the message names the option, its value and the cure.
    """
    if not 0 < port < 1 << 16:
        raise ValueError(f"--port {port}: must lie in 1..65535")
    try:
        socket.getaddrinfo(host, port)
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"--host {host}: no such computer; 127.0.0.1 is this one") from error
