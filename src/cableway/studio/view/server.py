"""viser's server behind a guard: one socket that we opened, pages of this server alone, and a session for each page."""

from __future__ import annotations

import errno
import os
import re
import secrets
import socket
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from functools import partial
from http import HTTPStatus
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import viser
import viser.infra
import websockets.asyncio.server
from viser import _messages
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from cableway.core.errors import InputError
from cableway.figures.palette import BLUE, FONT_FILE, rgb
from cableway.studio.view.look import FONT, HEAD, LIGHT

LOOPBACK = ("127.0.0.1", "localhost", "[::1]", "::1")
"""Names of this machine for itself."""

PAGE = re.compile(r"/s/([\w-]{8,40})/?")
"""Path of the page and of the socket of a session, with its key."""

HEADERS = {"Content-Security-Policy": "frame-ancestors 'none'", "X-Content-Type-Options": "nosniff"}
"""No foreign page can lay this one under its own buttons."""


LATE = "Queued a .* on a closed connection"
"""viser's warning of what was drawn for a page that has gone meanwhile: one that comes back is drawn anew."""


class Server:
    """A running server of pages.

    Args:
        host: Address to listen on.
        port: Port, 0 for any free one.
        on_page: Called with each connection and the key of its session, in a thread of its own.
        on_gone: The same once the connection is over.

    Attributes:
        address: Where the page is.

    Raises:
        InputError: Address or port cannot be had.
    """

    def __init__(
        self,
        host: str,
        port: int,
        on_page: Callable[[viser.ClientHandle, str], Any],
        on_gone: Callable[[viser.ClientHandle, str], Any],
    ) -> None:
        warnings.filterwarnings("ignore", LATE, UserWarning)
        self._socket = _listening(host, port)
        self._guard = _Guard(host, self._socket.getsockname()[1])
        with _serving(self._socket, self._guard) as served, redirect_stdout(StringIO()):
            self._viser = viser.ViserServer(host=host, port=self._guard.port, verbose=False)
        _dress(self._viser)
        if not served:
            self.stop()
            raise RuntimeError("viser's server was begun around the guard: cableway needs viser 1.1")
        for offer in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            self._viser._websock_server.unregister_handler(offer)  # which would lead pages through a foreign server
        name = "127.0.0.1" if host in ("", "0.0.0.0", "::") else host
        self.address = f"http://{name}:{self._guard.port}"
        keys: dict[int, str] = {}

        def connected(client: viser.ClientHandle) -> None:
            connection = self._viser._websock_server._live_connections.get(client.client_id)
            found = PAGE.fullmatch(connection.request.path) if connection and connection.request else None
            if found is not None:
                keys[client.client_id] = found[1]
                on_page(client, found[1])

        def gone(client: viser.ClientHandle) -> None:
            key = keys.pop(client.client_id, None)
            if key is not None:
                on_gone(client, key)

        self._viser.on_client_connect(connected)
        self._viser.on_client_disconnect(gone)

    @property
    def viser(self) -> viser.ViserServer:
        """What all pages share."""
        return self._viser

    def disconnect_all(self) -> None:
        """Cut all connections, as a bad network does; pages come back by themselves."""
        self._viser._websock_server.disconnect_all_clients()

    def stop(self) -> None:
        """Close the server."""
        with redirect_stdout(StringIO()):
            self._viser.stop()
        self._socket.close()


def _dress(server: viser.ViserServer) -> None:
    """What every page gets first: lights of the studio's own, since a browser takes a second for those of viser."""
    server.scene.configure_default_lights(enabled=False)
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light/all", intensity=LIGHT[0])
    server.scene.add_light_directional("/light/sun", intensity=LIGHT[1], position=(0, 0, 2), cast_shadow=False)
    server.gui.set_panel_label("cableway studio")
    server.gui.configure_theme(brand_color=rgb(BLUE), show_logo=False, show_share_button=False)


def _listening(host: str, port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise InputError(f"--port must be from 0 to 65535, got {port}")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family, backlog=100)
    except OSError as error:
        if (error.errno or 0) < 0 or error.errno == errno.EADDRNOTAVAIL:  # below zero: no such name
            raise InputError(f"--host {host}: no address of this machine") from None
        why = os.strerror(error.errno or 0)
        raise InputError(
            f"--port {port}: cannot be had on {host} ({why}); give another one, or 0 for any that is free"
        ) from None


@contextmanager
def _serving(listening: socket.socket, guard: _Guard) -> Iterator[list[bool]]:
    """What viser begins meanwhile listens on that socket and asks the guard first.

    Note:
        viser has no option for either, and takes the next port where one is taken.
    """
    serve, served = websockets.asyncio.server.serve, []

    def guarded(handler: Any, host: str, port: int, *, process_request: Any, **options: Any) -> Any:
        served.append(True)
        return serve(handler, sock=listening, process_request=partial(guard, process_request), **options)

    websockets.asyncio.server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield served
    finally:
        websockets.asyncio.server.serve = serve


class _Guard:
    """Answers requests: only pages that come from this server may open a socket to it."""

    def __init__(self, host: str, port: int) -> None:
        self.port = port
        self._names = LOOPBACK if host in LOOPBACK else None
        built = Path(viser.__file__).parent / "client" / "build" / "index.html"
        page = built.read_text(encoding="utf-8")
        start = page.index("<head>") + len("<head>")
        self._page = (page[:start] + HEAD + page[start:]).encode()

    def __call__(self, served: Any, connection: Any, request: Request) -> Response | None:
        """Refuse, answer, or leave to viser (None)."""
        del served, connection
        host = request.headers.get("Host", "")
        if not self._is_ours(host):
            return _response(HTTPStatus.FORBIDDEN, b"This address is not one of cableway studio.\n")
        path = request.path.partition("?")[0]
        page = PAGE.fullmatch(path)
        if request.headers.get("Upgrade", "").lower() == "websocket":
            if page is None or request.headers.get("Origin") != f"http://{host}":
                return _response(HTTPStatus.FORBIDDEN, b"Only pages of this server may connect to it.\n")
            return None
        if path == "/":
            return _response(HTTPStatus.FOUND, b"", Location=f"/s/{secrets.token_urlsafe(12)}")
        if page is not None:
            return _response(HTTPStatus.OK, self._page, kind="text/html; charset=utf-8")
        if path == FONT:
            return _response(
                HTTPStatus.OK, FONT_FILE.read_bytes(), kind="font/ttf", **{"Cache-Control": "max-age=86400"}
            )
        return _response(HTTPStatus.NOT_FOUND, b"Nothing is here.\n")

    def _is_ours(self, host: str) -> bool:
        """Whether a page asked for this machine by a name that is its own: another may be a foreign page's."""
        try:
            found = urlsplit(f"http://{host}")
            return found.port in (self.port, None) and (self._names is None or found.hostname in self._names)
        except ValueError:
            return False


def _response(status: HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8", **more: str) -> Response:
    headers = Headers({**HEADERS, "Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close"})
    headers.update({"Cache-Control": "no-store", **more})
    return Response(status.value, status.phrase, headers, body)
