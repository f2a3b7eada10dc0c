"""Refusal of requests that neither a simulator nor the page of this server sends.

Any web page that is open in a browser on this computer can send requests to this server. Browsers say in `Origin` and
`Sec-Fetch-Site` which page sends them; a page that reaches this computer by a domain name of its own (DNS rebinding)
is recognised by `Host`.
"""

import ipaddress
import math
import socket
import time
from collections.abc import Callable, Iterable
from typing import Any
from urllib.parse import parse_qs

from pilot.driving.connections import SILENT_SECONDS, PromptSocket

Application = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]
LARGEST_BODY = 1024  # bytes; the page sends {"mph": 12.5}
STREAM = "/events"  # a response without end
HEADERS = [
    (
        "Content-Security-Policy",
        "default-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    ("X-Frame-Options", "DENY"),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
]


class Gate:
    """WSGI application in front of another one, which lets only requests of simulators and of the page pass."""

    def __init__(self, application: Application, host: str, warn: Callable[[str, object], None]) -> None:
        """Create a gate.

        Args:
            application: that answers the requests.
            host: address or name to which the server is bound; requests may name it as their host.
            warn: called with the kind of a refusal and its details.
        """
        self.application, self.warn = application, warn
        self.names = {"localhost", host.lower(), *_own_names(host)}

    def __call__(self, environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
        """Answer a request."""

        def start(status: str, headers: list[tuple[str, str]], *exception: Any) -> Any:
            return start_response(status, [*headers, *HEADERS], *exception)

        if refusal := self._refusal(environ):
            self.warn("request refused", refusal)
            start(refusal[:3] + " Refused", [("Content-Type", "text/plain; charset=utf-8")])
            return [refusal.encode()]
        establish(environ)
        return self.application(environ, start)

    def _refusal(self, environ: dict[str, Any]) -> str:
        """Return status and reason of a refusal; empty: the request may pass."""
        host, origin = environ.get("HTTP_HOST", ""), environ.get("HTTP_ORIGIN")
        if not self._is_own(host):
            return f"421 {host[:80]!r} is not a name of this server: use its address, or start it with --host NAME"
        if origin is not None and origin.lower() != f"http://{host.lower()}":
            return f"403 a page of {origin[:80]!r} may not use this server"
        if environ.get("HTTP_SEC_FETCH_SITE", "none") not in {"same-origin", "none"} and not _is_visit(environ):
            return "403 a page of another site may not use this server"
        if "HTTP_TRANSFER_ENCODING" in environ or int(environ.get("CONTENT_LENGTH") or 0) > LARGEST_BODY:
            return f"413 a request has at most {LARGEST_BODY} bytes"
        if environ["PATH_INFO"].lstrip("/").startswith("socket.io") and not _is_websocket(environ):
            return "400 Socket.IO is served by WebSocket only"
        return ""

    def _is_own(self, host: str) -> bool:
        name = host.lower().rpartition(":")[0] if host.rpartition(":")[2].isdecimal() else host.lower()
        return name in self.names or _is_address(name)


def establish(environ: dict[str, Any]) -> None:
    """Extend the deadline of a request's connection if its answer has no end: the page's events and WebSockets."""
    client = connection_of(environ)
    if client is not None and environ["PATH_INFO"] == STREAM:
        client.established, client.deadline = True, math.inf  # closed when sending fails or takes too long
    elif client is not None and "HTTP_SEC_WEBSOCKET_KEY" in environ:
        client.established, client.deadline = True, time.monotonic() + SILENT_SECONDS


def connection_of(environ: dict[str, Any]) -> PromptSocket | None:
    """Return the socket of a request; None if it did not come through a `PromptSocket`."""
    request = environ.get("eventlet.input")
    client = request.get_socket() if request is not None else None
    return client if isinstance(client, PromptSocket) else None


def _own_names(host: str) -> set[str]:
    """Return the names of this computer if others can connect to it."""
    if _is_address(host) and ipaddress.ip_address(host).is_loopback:
        return set()
    own = socket.gethostname().lower()
    return {own, f"{own}.local"}


def _is_address(name: str) -> bool:
    """Whether a host is an IP address, which no domain's owner can redirect to this computer."""
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def _is_visit(environ: dict[str, Any]) -> bool:
    """Whether the user opens the page by a link of another site."""
    return environ.get("HTTP_SEC_FETCH_MODE") == "navigate" and environ["PATH_INFO"] == "/"


def _is_websocket(environ: dict[str, Any]) -> bool:
    """Whether this is the handshake of the simulator, as Engine.IO and eventlet accept it (RFC 6455)."""
    query = parse_qs(environ.get("QUERY_STRING", ""))
    connection = {part.strip() for part in environ.get("HTTP_CONNECTION", "").lower().split(",")}
    return (
        environ["REQUEST_METHOD"] == "GET"
        and query.get("transport") == ["websocket"]
        and not query.keys() & {"sid", "j"}
        and "upgrade" in connection
        and environ.get("HTTP_UPGRADE", "").lower() == "websocket"
        and environ.get("HTTP_SEC_WEBSOCKET_VERSION") == "13"
        and "HTTP_SEC_WEBSOCKET_KEY" in environ
    )
