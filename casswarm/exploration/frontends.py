"""Front ends of a session: the notebook widget, and the local page.

The page has a server for this computer alone, at a random port and under a random token.
"""

from __future__ import annotations

import json
import secrets
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from http import HTTPStatus
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from queue import Full, Queue
from typing import TYPE_CHECKING, Any

from ..errors import ExtraError
from .session import Session
from .view import View

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import ServerConnection

    from ..scenario import Scenario


_SCRIPT = ("elements.js", "messages.js", "map.js", "controls.js", "results.js", "view.js")
"""Parts of ``explore.js``, a single module, because a widget cannot import another one."""

PAGE = ("page.html", "page.js", "page.css", "explore.js", "explore.css")
"""What the local page consists of."""


@cache
def static_text(name: str) -> str:
    """Text of a file of ``static/``, or of ``explore.js``, which consists of several."""
    folder = files(__package__).joinpath("static")
    parts = _SCRIPT if name == "explore.js" else (name,)
    return "\n".join(folder.joinpath(part).read_text(encoding="utf-8") for part in parts)


HOST = "127.0.0.1"

_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css"}
_MAX_BYTES = 1 << 16  # of a message of the page
_MAX_WAITING = 1000  # messages that a page has not read


@contextmanager
def page_server(session: Session) -> Iterator[str]:
    """Serve the page of a session in threads during the block; yields its address.

    The process that computes ends when the last page is closed, and starts again with the next.

    Raises
    ------
    ExtraError
        The package websockets is not installed.
    """
    try:
        from websockets.sync.server import serve
    except ImportError as error:
        raise ExtraError(
            "casswarm explore needs websockets: pip install 'casswarm[explore]'",
            package="websockets",
            extra="explore",
        ) from error
    pages = _Pages(session)
    with serve(
        pages.converse,
        HOST,
        0,
        process_request=pages.respond,
        origins=None,  # `respond` checks them
        compression=None,
        max_size=_MAX_BYTES,
    ) as server:
        pages.host = f"{HOST}:{server.socket.getsockname()[1]}"
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://{pages.host}/{pages.token}/"
        finally:
            pages.end()
            session.close()


class _Pages:
    """Request handlers of the server: files of the page, and its messages.

    A request needs the token in its path and the server's own name as its host, so that pages of
    other sites reach nothing.
    """

    def __init__(self, session: Session) -> None:
        self.host, self.token = "", secrets.token_urlsafe(24)
        self._session = session
        self._connections: set[ServerConnection] = set()

    def respond(self, connection: ServerConnection, request: Request) -> Response | None:
        """Response to a request of a file; None lets a WebSocket open."""
        origin = request.headers.get("Origin", f"http://{self.host}")
        own = request.headers.get("Host") == self.host and origin == f"http://{self.host}"
        prefix = f"/{self.token}/"
        if not own or not secrets.compare_digest(
            request.path[: len(prefix)].encode(), prefix.encode()
        ):
            return connection.respond(HTTPStatus.FORBIDDEN, "unknown address\n")
        name = request.path[len(prefix) :] or "page.html"
        if name == "socket":
            return None
        if name not in PAGE:
            return connection.respond(HTTPStatus.NOT_FOUND, "no such file\n")
        response = connection.respond(HTTPStatus.OK, static_text(name))
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = f"{_TYPES[name.rpartition('.')[2]]}; charset=utf-8"
        response.headers["Content-Security-Policy"] = (
            f"default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; "
            f"connect-src ws://{self.host}; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response

    def converse(self, connection: ServerConnection) -> None:
        """Pass messages on between a page and a view of its own, until the page is closed."""
        from websockets.exceptions import ConnectionClosed

        outbox = _Outbox(connection)
        view = View(self._session, outbox.put)
        self._connections.add(connection)
        try:
            with suppress(ConnectionClosed):
                for text in connection:
                    with suppress(ValueError, RecursionError):  # no JSON, or nested too deeply
                        view.receive(json.loads(text))
        finally:
            self._connections.discard(connection)
            view.close()
            outbox.close()

    def end(self) -> None:
        """Close the pages' connections, also of those that do not read."""
        for connection in tuple(self._connections):
            _cut(connection)


class _Outbox:
    """Messages to a page, which a thread sends: a page that does not read delays no other.

    After `_MAX_WAITING` messages that the page has not read, its connection is closed.
    """

    def __init__(self, connection: ServerConnection) -> None:
        self._connection = connection
        self._texts: Queue[str] = Queue(_MAX_WAITING)
        threading.Thread(target=self._send, daemon=True).start()

    def put(self, message: dict[str, Any]) -> None:
        """Add a message, without waiting."""
        self._put(json.dumps(message, allow_nan=False))

    def close(self) -> None:
        """End the thread, after the messages before."""
        self._put("")

    def _put(self, text: str) -> None:
        try:
            self._texts.put_nowait(text)
        except Full:
            _cut(self._connection)

    def _send(self) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            for text in iter(self._texts.get, ""):
                self._connection.send(text)


def _cut(connection: ServerConnection) -> None:
    """Close a connection without waiting for its page."""
    with suppress(OSError):
        connection.socket.shutdown(socket.SHUT_RDWR)


def explore(scenario: Scenario, policy: str = "leader", *, file: str | Path | None = None) -> Any:
    """Widget in which a scenario is changed by hand, and its answers follow.

    Radars, members and the target are dragged, or moved by the arrow keys; parameters have
    sliders. The guide follows first, then a proven bound on its survival, and the success of the
    policy: proven bounds where its states can be enumerated quickly, else a 95 % interval of
    runs, which becomes narrower while nothing changes.

    Of a hazard that is not known (``hazard.case``), a radar that only some cases have is dragged
    with the others of its cloud. A mixture of guides, its value and the worst prior follow; a
    slider goes from the prior to the worst case.

    Parameters
    ----------
    scenario : Scenario
    policy : str
        Name of a policy: see `make_policy`.
    file : str or path, optional
        Where the button Save writes the present scenario, by default a new file
        NAME-explored.toml in the current folder.

    Returns
    -------
    widget
        An `anywidget.AnyWidget`, for Jupyter, VS Code, Colab and marimo. Its attributes are those
        of the present state: `scenario`; `guide`, `mixture` (of a hazard that is not known) and
        `study`, which wait until they are computed;
        `session`, with `undo`, `change` and more. The trait `revision` changes when the view shows
        another state and nothing moves any more: ``widget.observe(function, "revision")``. In
        marimo, cells that use ``mo.ui.anywidget(widget)`` then run again. Everything runs on this
        computer, in another process; ``widget.close()`` ends it.

    Raises
    ------
    ExtraError
        The package anywidget is not installed: ``pip install 'casswarm[explore]'``.
    PolicyError
        An unknown policy.

    Notes
    -----
    Custom rates that are functions of a notebook work; the function is sent to the process.
    """
    session = Session(scenario, policy, None if file is None else Path(file))
    return _widget_class()(session)


@cache
def _widget_class() -> type[Any]:
    """The class, which exists only where anywidget is installed."""
    try:
        import anywidget
        from traitlets import Int
    except ImportError as error:
        raise ExtraError(
            "csw.explore needs anywidget: pip install 'casswarm[explore]'",
            package="anywidget",
            extra="explore",
        ) from error

    class ExploreWidget(anywidget.AnyWidget):  # type: ignore[misc, unused-ignore]
        """A scenario that is changed by hand: see `casswarm.explore`."""

        _esm = static_text("explore.js")
        _css = static_text("explore.css")
        revision = Int(0, help="Number of the state that the view shows.").tag(sync=True)

        def __init__(self, session: Session) -> None:
            super().__init__()
            self.session = session
            self._view = View(session, self.send)
            self.on_msg(self._receive)

        def _receive(self, _widget: object, content: Any, _buffers: object) -> None:
            self._view.receive(content)

        scenario = property(attrgetter("session.scenario"), doc="The present scenario.")
        guide = property(attrgetter("session.guide"), doc="Its guide.")
        mixture = property(attrgetter("session.mixture"), doc="Mixture for an unknown hazard.")
        study = property(attrgetter("session.study"), doc="Its largest study so far.")

        def close(self) -> None:
            """Close the widget, and end the process that computes."""
            self.session.close()
            super().close()

    return ExploreWidget
