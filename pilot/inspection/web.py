"""HTTP server of the data page."""

from collections.abc import Callable
from typing import Any

from werkzeug.serving import BaseWSGIServer, WSGIRequestHandler, make_server


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
