"""Laws of the page without a browser: who may open it, in what order hands are heard, and what colours come out."""

from __future__ import annotations

import asyncio
import http.client
import inspect
import socket
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from spatial_problems import ball_task

from cableway.core.errors import InputError
from cableway.figures import palette
from cableway.geometry import se2
from cableway.rendering.cell import Capsules
from cableway.rendering.mesh import capsules
from cableway.rendering.mesh import prism as upright
from cableway.rendering.mesh import tube as tube_in_space
from cableway.scene.task import Draft
from cableway.studio.inbox import Inbox
from cableway.studio.opening import opened
from cableway.studio.studio import Studio
from cableway.studio.view import arms, look, table
from cableway.studio.view.canvas import Canvas
from cableway.studio.view.dragging import Drags
from cableway.studio.view.events import in_order
from cableway.studio.view.meshes import CORD, circle, cord, creases, prism, ribbon, ring, tube, welded
from cableway.studio.view.page import LONG, TELL, Page
from cableway.studio.view.server import Server

LINE = np.array([[0.0, 0], [1, 0], [2, 1]])

UPGRADE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
    "Sec-WebSocket-Version": "13",
}  # fmt: skip


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    server = Server("127.0.0.1", 0, lambda *_: None, lambda *_: None)
    yield server
    server.stop()


def status(server: Server, path: str, **headers: str) -> tuple[int, dict[str, str]]:
    connection = http.client.HTTPConnection(server.address.removeprefix("http://"), timeout=10)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders())
    connection.close()
    return found


def test_a_browser_is_answered_before_there_is_a_session(monkeypatch: pytest.MonkeyPatch):
    """Which then has time to load the page while what plans is imported; of a task that is none nobody is told."""
    told: list[int] = []

    def announce(address: str) -> None:
        connection = http.client.HTTPConnection(address.removeprefix("http://"), timeout=10)
        connection.request("GET", "/s/abcdefghij")
        told.append(connection.getresponse().status)
        assert made == []

    class Made(Studio):
        def _session(self, key: str) -> Any:
            raise AssertionError(key)

    made: list[Any] = []
    session: Any = SimpleNamespace(close=lambda: made.append("closed"))
    monkeypatch.setattr("cableway.studio.session.Session", lambda *_: made.append("begun") or session)
    with pytest.raises(InputError, match="unknown task"):
        Made("nowhere", announce=announce)
    assert told == []
    Made("single-obstacle-1", announce=announce).stop()
    assert told == [200]
    assert made == ["begun", "closed"]


def test_in_a_drag_the_numbers_are_told_now_and_then(monkeypatch: pytest.MonkeyPatch):
    """And all of them once nothing is held."""
    page, told = Page.__new__(Page), []
    panel: Any = SimpleNamespace(show=lambda *_: told.append(time.monotonic()))
    page._told, page._selected, page._task_panel = 0.0, None, panel
    held: Any = object()
    page._drags = Drags.__new__(Drags)
    for page._drags.held, now in (
        (held, 9.0),
        (held, 9.0 + 0.9 * TELL),
        (held, 9.0 + 1.1 * TELL),
        (None, 9.3),
        (None, 9.3),
    ):
        monkeypatch.setattr("time.monotonic", lambda now=now: now)
        page._show_task(held, held)
    assert told == [9.0, 9.0 + 1.1 * TELL, 9.3, 9.3]


@pytest.mark.parametrize(
    ("moment", "status", "passed", "delay"),
    [
        ("shown", "planning", 0.0, LONG),
        ("shown", "planning", 0.75 * LONG, 0.25 * LONG),
        ("shown", "planning", 2 * LONG, 0.0),
        ("shown", "found", 0.0, 0.0),
        ("undone", "planning", 0.0, 0.0),
    ],
)
def test_that_it_plans_is_said_once_it_takes_long(
    monkeypatch: pytest.MonkeyPatch, moment: Any, status: str, passed: float, delay: float
):
    """What hands changed and what was found is shown at once."""
    page, delays = Page.__new__(Page), []
    session: Any = SimpleNamespace(moment=moment, planning=SimpleNamespace(status=status), running=None)
    shown: Any = "shown"
    page._session, page._moment, page._drags = session, shown, Drags.__new__(Drags)
    page._drags.released = 50.0
    page._do = lambda do, key="", delay=0.0: delays.append(delay)
    monkeypatch.setattr("time.monotonic", lambda: 50.0 + passed)
    page._changed()
    assert delays == pytest.approx([delay])


def test_every_page_gets_a_key_of_its_own(server: Server):
    places = {status(server, "/")[1]["Location"] for _ in range(3)}
    assert len(places) == 3
    for place in places:
        found, headers = status(server, place)
        assert found == 200
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", ""])
def test_a_foreign_page_opens_no_socket(server: Server, origin: str):
    assert status(server, "/s/abcdefghij", Origin=origin, **UPGRADE)[0] == 403


def test_a_page_of_its_own_does(server: Server):
    assert status(server, "/s/abcdefghij", Origin=server.address, **UPGRADE)[0] == 101
    assert status(server, "/", Origin=server.address, **UPGRADE)[0] == 403  # without a session's key


def test_a_foreign_name_of_this_machine_is_refused(server: Server):
    """As a page asks for whose name its owner lets point here (DNS rebinding)."""
    port = server.address.rpartition(":")[2]
    evil = f"evil.example:{port}"
    assert status(server, "/", Host=evil)[0] == 403
    assert status(server, "/s/abcdefghij", Host=evil, Origin=f"http://{evil}", **UPGRADE)[0] == 403


def test_nothing_else_is_served(server: Server):
    for path in ("/s/", "/../pyproject.toml", "/s/abcdefghij/../../x", "/index.html"):
        assert status(server, path)[0] == 404


def test_a_port_in_use_is_said():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port {port}: cannot be had on 127.0.0.1 .*; give another one"):
            Server("127.0.0.1", port, lambda *_: None, lambda *_: None)
    with pytest.raises(InputError, match=r"--host 203\.0\.113\.1: no address of this machine"):
        Server("203.0.113.1", 0, lambda *_: None, lambda *_: None)  # of nobody (RFC 5737)
    with pytest.raises(InputError, match="--port must be from 0 to 65535, got 70000"):
        Server("127.0.0.1", 70000, lambda *_: None, lambda *_: None)


def test_hands_are_heard_in_order_and_the_newest_of_what_waits():
    done, go, end = [], threading.Event(), threading.Event()
    inbox = Inbox(done.append)
    inbox.post(go.wait)
    inbox.post(lambda: done.append("grab"))
    for k in range(5):
        inbox.post(lambda k=k: done.append(k), key="drag")
    inbox.post(lambda: done.append("let go"))
    for key in ("right", "right", "left"):  # steps from where things are: none is lost, none overtakes
        inbox.post(lambda key=key: done.append(key))
    inbox.post(lambda: 1 / 0)
    inbox.post(end.set)
    go.set()
    assert end.wait(10)
    inbox.close()
    assert done[:6] == ["grab", 4, "let go", "right", "right", "left"]
    assert "division by zero" in done[6]


def test_what_a_page_tells_is_heard_as_it_comes():
    """viser awaits functions of asyncio one after the other, and hands others to threads, of which any may be first."""
    heard: list[str] = []
    hear = in_order(heard.append)
    assert inspect.iscoroutinefunction(hear)
    asyncio.run(hear("right"))
    assert heard == ["right"]


def test_two_drags_of_one_thing_are_two():
    """Also where the page was too slow for the first, which is not replaced by the second."""
    done: list[str] = []
    unused: Any = None
    drags = Drags(unused, lambda do, key="", delay=0.0: done.append(key), unused)
    for phase in ("start", "update", "end") * 2:
        drags.dragged("/obstacles/0", phase, (0.0, 0.0))
    assert done == ["", "drag 1", "drag 1", "drag 1", "", "", "drag 2", "drag 2", "drag 2", ""]


@pytest.mark.parametrize(
    "color", [palette.OBSTACLE, palette.START, palette.GOAL, palette.INK, palette.LEFT, palette.ORANGE]
)
def test_a_painted_colour_comes_out_as_that_of_the_figures(color: str):
    """Through the light and the tone curve of the page, as three.js has them."""
    linear = look._linear(np.array(look.painted(color)) / 255) * sum(look.LIGHT) / np.pi
    v = look._TO_TONE @ (linear / 0.6)
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    shown = look._coded(np.clip(look._FROM_TONE @ v, 0, 1))
    np.testing.assert_allclose(255 * shown, look.rgb(color), atol=34)  # a curve that leaves no colour pure


def test_meshes_whose_corners_are_shared_are_the_surfaces_that_they_stand_for():
    """Also where other ones have the same triangles, as of a cable that moves or of arms."""
    rng = np.random.default_rng(0)
    for _ in range(2):
        line = np.cumsum(rng.uniform(0.01, 0.02, (9, 3)), axis=0)
        ends, radii = rng.uniform(0.0, 1.0, (3, 2, 3)), rng.uniform(0.05, 0.1, 3)
        for made, surface in (
            (cord(line, 0.004), tube_in_space(line, 0.004, CORD)),
            (arms.links_mesh(Capsules(ends, radii)), capsules(ends, radii, arms.ROUND, arms.RINGS)),
            (welded(capsules(ends[:1], radii[:1])), capsules(ends[:1], radii[:1])),
        ):
            np.testing.assert_allclose(made.vertices[made.faces], surface.corners, atol=1e-6)
            edges = np.sort(made.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
            assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()  # closed: each edge is of two
    box = upright(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]]), (0.0, 3.0))
    assert sorted(np.linalg.norm(np.diff(creases(box), axis=1)[:, 0], axis=1)) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4
    assert len(creases(capsules(ends[:1], radii[:1]))) == 0


def test_a_page_is_told_the_pose_of_what_takes_the_name_of_another():
    """Also where it is as usual: the page keeps that of the node that had the name."""
    told: list[tuple[str, Any]] = []

    class Handle(SimpleNamespace):
        position, wxyz = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])

        def __setattr__(self, name: str, value: Any) -> None:
            told.append((name, value))
            super().__setattr__(name, value)

    client: Any = SimpleNamespace(scene=SimpleNamespace(add_mesh_simple=lambda *_, **given: Handle(**given)))
    Canvas(client, *[lambda *_: None] * 3).solid("/obstacles/0", prism(circle(0.1), 0.0, 0.02), palette.INK)
    assert [value for name, value in told if name == "position"][-1] == (0.0, 0.0, 0.0)
    assert [value for name, value in told if name == "wxyz"][-1] == (1.0, 0.0, 0.0, 0.0)


def test_arms_and_hands_of_a_cell_are_where_its_kinematics_have_them():
    draft = opened("single-obstacle-2", "dual-ur5e").draft
    assert isinstance(draft, Draft)
    assert draft.cell is not None
    assert draft.grippers.body == draft.cell.tool
    assert opened(ball_task(), "dual-ur5e").draft.cell == draft.cell
    drawn: dict[str, Any] = {}
    canvas: Any = SimpleNamespace(solid=lambda name, mesh, color, **how: drawn.update({name: (mesh, how)}))
    poses = np.array([[0.2, 0.3, 0.5], [0.4, 0.3, -0.5]])
    arms.draw_hands(canvas, "/moment", draft, poses, 0.01)
    for side, pose in enumerate(poses):
        mesh, how = drawn[f"/moment/hand{side}"]
        assert (*how["at"], how["angle"]) == pytest.approx(tuple(pose))
        assert mesh.vertices[:, 2].max() == pytest.approx(max(each.heights[1] for each in draft.grippers.pieces))
    assert len(arms.outlines(draft, poses)) % 2 == 0


def test_a_port_is_on_top_of_the_obstacle_that_it_is_in():
    """And as wide as its plug, which fits between its walls."""
    draft = opened("insertion").draft
    assert isinstance(draft, Draft)
    assert draft.port is not None
    assert draft.plug is not None
    drawn: dict[str, Any] = {}
    canvas: Any = SimpleNamespace(
        solid=lambda name, mesh, color, **how: drawn.update({name: mesh.vertices}), lines=lambda *_: None,
        sweep=lambda prefix: None,
    )  # fmt: skip
    table.draw_obstacles(canvas, draft, None)
    top = max(vertices[:, 2].max() for name, vertices in drawn.items() if name.startswith("/obstacles"))
    assert all(vertices[:, 2].max() > top for name, vertices in drawn.items() if name.startswith("/port"))
    rear = draft.port.pose(draft.plug, draft.port.depth)
    local = [(draft.plug.length, side * draft.plug.width / 2) for side in (-1, 1)]
    tip = se2.transform(np.array(local), rear[:2], float(rear[2]))
    inside = shapely.Polygon(drawn["/port/inside"][:4, :2]).convex_hull.buffer(1e-6)
    assert all(inside.contains(shapely.Point(*corner)) for corner in tip)


@pytest.mark.parametrize(
    "mesh", [prism(circle(0.1), 0.0, 0.02), ring(0.1, 0.2, 0.0), tube(LINE, 0.1, 0.2), ribbon(LINE, 0.1, 0.2)]
)
def test_solids_are_seen_from_above(mesh: object):
    """What faces up, or the page would show holes."""
    vertices, faces = mesh  # pyright: ignore[reportGeneralTypeIssues]
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    up = normals[:, 2] > 1e-12 * np.abs(normals).max()
    top = (a[:, 2] + b[:, 2] + c[:, 2])[up]
    assert up.any()
    assert top.mean() >= vertices[:, 2].mean() * 3 - 1e-9
