"""HTTP server of the data page."""

import threading
import time
from collections.abc import Callable
from typing import Any

from werkzeug.serving import BaseWSGIServer, WSGIRequestHandler, make_server

from pilot.interrupt import catch_interrupt


class _Quiet(WSGIRequestHandler):
    def log(self, *_arguments: object) -> None:
        """Print nothing of each request."""


def listening(host: str, port: int, application: Callable[..., Any]) -> BaseWSGIServer:
    """Return a server that listens; each request has a thread of its own.

    Raises:
        OSError: the port is in use, or the address is not this computer's; the message says what to do.
    """
    try:
        return make_server(host, port, application, threaded=True, request_handler=_Quiet)
    except (OSError, SystemExit) as error:  # werkzeug exits by itself if the port is in use
        cure = "stop the other program, or take another --port"
        raise OSError(f"cannot listen on {host}:{port}: {cure}") from error


def serve_until_interrupted(server: BaseWSGIServer) -> None:
    """Serve in a thread.

    Raises:
        KeyboardInterrupt: on Ctrl-C or SIGTERM.
    """
    thread = threading.Thread(target=server.serve_forever, name="server", daemon=True)
    thread.start()
    with catch_interrupt() as interrupt:
        while not interrupt.asked and thread.is_alive():
            time.sleep(0.1)
        server.shutdown()
        server.server_close()
        interrupt.raise_if_asked()
