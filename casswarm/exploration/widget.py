"""The widget of a notebook."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExtraError
from ..guide.guide import Guide
from ..studies.simulation import Study
from .server import static_text
from .session import Session
from .view import View

if TYPE_CHECKING:
    from ..scenario import Scenario


def explore(scenario: Scenario, policy: str = "leader", *, file: str | Path | None = None) -> Any:
    """Widget in which a scenario is changed by hand, and its answers follow.

    Radars, members and the target are dragged, or moved by the arrow keys; parameters have
    sliders. The guide follows first, then a proven bound on its survival, and the success of the
    policy: proven bounds where its states can be enumerated quickly, else a 95 % interval of
    runs, which becomes narrower while nothing changes.

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
        of the present state: `scenario`; `guide` and `study`, which wait until they are computed;
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

        @property
        def scenario(self) -> Scenario:
            """The present scenario."""
            return self.session.scenario

        @property
        def guide(self) -> Guide:
            """The guide of the present scenario."""
            return self.session.guide

        @property
        def study(self) -> Study:
            """The largest study of the present scenario so far."""
            return self.session.study

        def close(self) -> None:
            """Close the widget, and end the process that computes."""
            self.session.close()
            super().close()

    return ExploreWidget
