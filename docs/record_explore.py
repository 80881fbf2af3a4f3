"""Record the pictures of casswarm explore in docs/images, with headless Chromium.

A radar of crossfire is dragged into the way of the guide, step by step; every frame of explore.gif
shows the page once its answer is complete. In explore-cases.png, the radars of two-gaps that may be
absent were dragged, and the ambiguity is that of the worst case. Needs the extra explore::

    python docs/record_explore.py [crossfire] [two-gaps]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

import casswarm as csw
from casswarm.exploration.frontends import page_server
from casswarm.exploration.session import Session

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))
from devtools import Page, opened_page  # noqa: E402  (a helper of the tests)

IMAGES = ROOT / "docs" / "images"
RADAR, FRAMES, WIDTH = "[data-point='radar 4']", 18, 720
TO = (0.0, 150.0)  # pixels
CASES_RADAR = "[data-point='radar 2']"
SHOWN = ".csw-main"
READY = (
    "document.querySelector('.csw')?.dataset.busy === 'false' "
    "&& document.querySelector('.csw-guide').points.length"
)


def frames(page: Page, folder: Path) -> list[Image.Image]:
    """Pictures of the page while the radar is dragged."""
    pictures = []
    x, y = page.center(RADAR)
    page.mouse("mousePressed", x, y)
    for k in range(FRAMES + 1):
        page.mouse("mouseMoved", x + TO[0] * k / FRAMES, y + TO[1] * k / FRAMES)
        page.value("new Promise((done) => setTimeout(done, 300))")
        page.wait(READY, 120)
        page.screenshot(folder / "frame.png", SHOWN)
        with Image.open(folder / "frame.png") as picture:
            height = round(picture.height * WIDTH / picture.width)
            pictures.append(picture.convert("RGB").resize((WIDTH, height)))
    page.mouse("mouseReleased", x + TO[0], y + TO[1])
    return pictures


def palette_of(picture: Image.Image) -> Image.Image:
    """128 shades of the hazard, and as many other colours of a picture."""
    other = picture.quantize(128, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
    alphas = [0.55 * k / 127 for k in range(128)]
    shades = [round(255 + a * (c - 255)) for a in alphas for c in (213, 94, 0)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(shades + other[: 3 * 128])
    return palette


@contextmanager
def explored(name: str) -> Iterator[tuple[Page, str]]:
    """The page of a scenario with its first answer, and a temporary folder."""
    with (
        tempfile.TemporaryDirectory() as folder,
        page_server(Session(csw.load_scenario(name))) as address,
        opened_page(Path(folder), height=800) as page,
    ):
        page.open(address)
        page.wait(READY, 300)
        yield page, folder


def record_cases() -> None:
    """Write explore-cases.png."""
    with explored("two-gaps") as (page, _):
        slider = "document.querySelector('input[type=range][name=ambiguity]')"
        page.value(f"{slider}.value = 1; {slider}.dispatchEvent(new Event('input'))")
        page.value(f"{slider}.dispatchEvent(new Event('change'))")
        x, y = page.center(CASES_RADAR)
        page.drag(CASES_RADAR, (x + 30, y - 15))
        page.value("new Promise((done) => setTimeout(done, 500))")
        page.wait(READY, 120)
        page.screenshot(IMAGES / "explore-cases.png", ".csw")


def record_drag() -> None:
    """Write explore.png and explore.gif."""
    with explored("crossfire") as (page, folder):
        page.value("document.querySelector('details').open = false")
        pictures = frames(page, Path(folder))
        page.value("document.querySelector('details').open = true")
        page.value(
            "(() => { const s = document.querySelector('.csw-player input');"
            " s.value = 14.5; s.dispatchEvent(new Event('input')); })()"
        )
        page.screenshot(IMAGES / "explore.png", ".csw")
    palette = palette_of(pictures[-1])
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    small[0].save(
        IMAGES / "explore.gif",
        save_all=True,
        append_images=small[1:],
        duration=[1200] + [200] * (FRAMES - 1) + [2500],
        loop=0,
        optimize=True,
    )


RECORDS = {"crossfire": record_drag, "two-gaps": record_cases}

if __name__ == "__main__":
    for chosen in sys.argv[1:] or RECORDS:
        RECORDS[chosen]()
