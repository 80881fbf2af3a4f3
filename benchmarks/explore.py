"""Time from a movement of the pointer to the new guide on the page of casswarm explore.

In headless Chromium, a radar is dragged in a circle across the guide's way. After every movement
the page is watched until it draws another guide; the next movement follows. Needs Chromium and the
extra explore::

    python benchmarks/explore.py crossfire single-agent paper-2
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

import casswarm as csw
from casswarm.exploration.frontends import page_server
from casswarm.exploration.session import Session

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
from devtools import opened_page

MOVES = 40
RADIUS = 120  # pixels of the circle
READY = (
    "document.querySelector('.csw')?.dataset.busy === 'false' "
    "&& document.querySelector('.csw-guide').points.length"
)
WATCH = """
(() => {
  const guide = document.querySelector(".csw-guide");
  const radar = document.querySelector("[data-point='radar 0']");
  window.drawn = null;
  radar.addEventListener("pointermove", () => { window.moved = performance.now(); });
  new MutationObserver(() => {
    const now = guide.getAttribute("points");
    if (now !== window.before) { window.before = now; window.drawn = performance.now(); }
  }).observe(guide, { attributes: true, attributeFilter: ["points"] });
})()
"""


def milliseconds(name: str) -> list[float]:
    """Times of the movements in a scenario, planned by a global search."""
    scenario = csw.load_scenario(name).with_values({"guide.search": "global"})
    times = []
    with (
        tempfile.TemporaryDirectory() as folder,
        page_server(Session(scenario)) as address,
        opened_page(Path(folder)) as page,
    ):
        page.open(address)
        page.wait(READY, 300)
        page.value(WATCH)
        x, y = page.center("[data-point='radar 0']")
        page.mouse("mousePressed", x, y)
        for k in range(1, MOVES):
            angle = 2 * math.pi * k / MOVES
            page.value(
                "window.before = document.querySelector('.csw-guide').getAttribute('points')"
            )
            page.value("window.drawn = null")
            to = (x + RADIUS * math.sin(angle), y + RADIUS * (1 - math.cos(angle)))
            page.mouse("mouseMoved", *to)
            times.append(page.wait("window.drawn && window.drawn - window.moved", 60))
        page.mouse("mouseReleased", x, y)
    return times


def main(names: list[str]) -> None:
    """Print a line per scenario."""
    print(f"{'scenario':14s} median  90 %  largest, in ms of {MOVES - 1} movements")
    for name in names:
        times = milliseconds(name)
        numbers = (np.median(times), np.quantile(times, 0.9), max(times))
        print(f"{name:14s}" + " ".join(f"{number:6.0f}" for number in numbers))


if __name__ == "__main__":
    main(sys.argv[1:] or ["single-agent", "crossfire", "paper-2"])
