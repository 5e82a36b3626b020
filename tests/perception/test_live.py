"""Pictures on a page of this machine."""

from __future__ import annotations

import http.client

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.perception.live import LiveView

cv2 = pytest.importorskip("cv2")


def asked(view: LiveView, path: str, host: str | None = None) -> http.client.HTTPResponse:
    link = http.client.HTTPConnection(view.names[0], timeout=20)
    link.request("GET", path, headers={} if host is None else {"Host": host})
    return link.getresponse()


def picture(stream: http.client.HTTPResponse) -> np.ndarray:
    """The next one of the stream, red, green and blue."""
    head = {}
    while line := stream.readline().strip():
        name, _, value = line.partition(b": ")
        head[name] = value
    data = stream.read(int(head[b"Content-Length"]))
    stream.readline()
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def test_browsers_of_this_machine_see_the_newest_picture():
    colors = [(200, 40, 40), (40, 200, 40)]
    images = [np.full((24, 32, 3), color, np.uint8) for color in colors]
    with LiveView() as view:
        assert b"/stream" in asked(view, "/").read()
        for image in images:
            view.show(image)
        late = asked(view, "/stream")
        assert np.abs(picture(late).mean(axis=(0, 1)) - colors[1]).max() < 3
        view.show(images[0])
        assert np.abs(picture(late).mean(axis=(0, 1)) - colors[0]).max() < 3
        assert asked(view, "/elsewhere").status == 404
        assert asked(view, "/stream", host="evil.example").status == 403
        with pytest.raises(InputError, match=f"port {view.address.rsplit(':')[-1][:-1]}"):
            LiveView(int(view.address.rsplit(":")[-1][:-1]))
    assert late.read() == b""
    with pytest.raises(ConnectionRefusedError):
        asked(view, "/")
