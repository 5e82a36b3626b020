"""Pictures as they are taken, on a page of this machine that any browser shows."""

from __future__ import annotations

import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

import numpy as np
from jaxtyping import UInt8

from cableway.core.errors import InputError
from cableway.core.extras import require

HOST = "127.0.0.1"
PARTS = "picture"
"""What parts the pictures of the stream from each other."""

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>cableway see</title>
<style>body{margin:0;background:#222;display:grid;place-items:center;min-height:100vh}
img{max-width:100vw;max-height:100vh}</style><img src="/stream" alt="The newest picture with the cable found in it">
"""


class LiveView:
    """Serves the newest picture to this machine alone, as a stream of JPEG pictures.

    Args:
        port: Where; 0 for any that is free.

    Raises:
        InputError: Something else listens there.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, port: int = 0) -> None:
        require("vision", "showing pictures")
        self._changed, self._newest, self._count, self._open = threading.Condition(), b"", 0, True
        try:
            self._server = ThreadingHTTPServer((HOST, port), self._handler())
        except OSError as error:
            raise InputError(f"cannot listen at port {port} of {HOST}: {error.strerror or error}") from None
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True).start()

    @property
    def names(self) -> tuple[str, str]:
        """Host and port by which this machine calls it."""
        return f"{HOST}:{self._server.server_port}", f"localhost:{self._server.server_port}"

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{self.names[0]}/"

    def show(self, image: UInt8[np.ndarray, "h w 3"]) -> None:
        """Show a picture (red, green, blue) from now on."""
        import cv2

        _, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        with self._changed:
            self._newest, self._count = encoded.tobytes(), self._count + 1
            self._changed.notify_all()

    def after(self, count: int) -> tuple[bytes, int] | None:
        """The newest picture and its number, once there is one after number `count`; None when the view is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._count > count or not self._open)
            return (self._newest, self._count) if self._open else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._open = False
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        view = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                # a foreign page that lets its own name point here asks by that name
                if self.headers.get("Host") not in view.names:
                    self.send_error(HTTPStatus.FORBIDDEN)
                elif self.path == "/":
                    self.send_response(HTTPStatus.OK)
                    self.send_header("Content-Type", "text/html")
                    self.end_headers()
                    self.wfile.write(PAGE.encode())
                elif self.path == "/stream":
                    self._stream()
                else:
                    self.send_error(HTTPStatus.NOT_FOUND)

            def _stream(self) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={PARTS}")
                self.end_headers()
                count = 0
                try:
                    while found := view.after(count):
                        picture, count = found
                        head = f"--{PARTS}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                        self.wfile.write(head.encode() + picture + b"\r\n")
                except OSError:  # the browser went away
                    return

            def log_message(self, format: str, *args: object) -> None:
                """Says nothing: requests are no news."""

        return Handler
