"""The studio: a server of pages, and a session for each of them, kept while its page is away."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cableway.core.extras import require
from cableway.studio.opening import opened

if TYPE_CHECKING:
    from cableway.studio.session import Session
    from cableway.studio.view.page import Page

KEPT = 20
"""Sessions kept of pages that are away; of more, those that were left first are dropped."""


class Studio:
    """Serves pages until it is stopped.

    Args:
        task: What a new page opens: a task, its name or its file, also one that no cable can do; or a plan or rollout.
        host: Address to listen on.
        port: Port, 0 for any free one.
        out: Folder in which tasks are saved, each in one of its own.
        seed: For planning.
        session: What every page shows; one of its own where None.
        announce: Told the address as soon as a browser may open it. It loads the page while planner and controllers are
            imported.

    Attributes:
        address: Where a new page is to be had.
        server: What serves the pages.

    Raises:
        InputError: There is no such task, or the port cannot be had.
        MissingExtraError: viser is not installed.
    """

    def __init__(
        self,
        task: Any,
        host: str = "127.0.0.1",
        port: int = 0,
        out: Path = Path("runs/studio"),
        seed: int = 0,
        session: Session | None = None,
        announce: Callable[[str], Any] = lambda _: None,
    ) -> None:
        require("studio", "cableway studio")
        from cableway.studio.view.server import Server

        self._lock = threading.Lock()
        self._out = out
        self._sessions: dict[str, Session] = {}
        self._pages: dict[int, tuple[str, Page]] = {}
        self._spare: Session | None = None
        self._ready = threading.Event()
        source = opened(task)
        self.server = Server(host, port, self._shown, self._gone)
        self.address = self.server.address
        try:
            announce(self.address)
            from cableway.studio.session import Session
            from cableway.workflow.run import SolveOptions

            self._begin = lambda: session or Session(source, SolveOptions(track=False, seed=seed))
            self._spare = self._begin()
        except BaseException:
            self.server.stop()
            raise
        finally:
            self._ready.set()

    @property
    def sessions(self) -> tuple[Session, ...]:
        """Those that there are."""
        return tuple(self._sessions.values())

    def pages_of(self, session: Session) -> tuple[int, ...]:
        """Numbers of the connections through which a session is shown now."""
        with self._lock:
            return tuple(number for number, (key, _) in self._pages.items() if self._sessions.get(key) is session)

    def wait(self) -> None:
        """Serve until the process is interrupted."""
        while True:
            time.sleep(3600.0)

    def stop(self) -> None:
        """Close all pages and sessions."""
        self.server.stop()
        spare = [] if self._spare is None else [self._spare]
        for session in (*self._sessions.values(), *spare):
            session.close()

    def _shown(self, client: Any, key: str) -> None:
        """A page has come; it waits until there is a session for it."""
        from cableway.studio.view.page import Page

        self._ready.wait()
        if self._spare is None and not self._sessions:  # the session could not be begun
            return
        page = Page(client, self._session(key), self._out)
        with self._lock:
            self._pages[client.client_id] = key, page
        if client.client_id not in self.server.viser.get_clients():  # it went meanwhile
            self._gone(client, key)

    def _gone(self, client: Any, key: str) -> None:
        with self._lock:
            known = self._pages.pop(client.client_id, None)
        if known is not None:
            known[1].close()
        self._drop()

    def _session(self, key: str) -> Session:
        """That of a key; the first page takes the one that was begun with the server."""
        with self._lock:
            if key not in self._sessions:
                spare, self._spare = self._spare, None
                self._sessions[key] = spare or self._begin()
            return self._sessions[key]

    def _drop(self) -> None:
        with self._lock:
            open_keys = {key for key, _ in self._pages.values()}
            left = [key for key in self._sessions if key not in open_keys]
            dropped = [self._sessions.pop(key) for key in left[:-KEPT]]
        for session in dropped:
            session.close()
