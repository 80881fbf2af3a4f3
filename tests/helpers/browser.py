"""A page in headless Chromium, where there is one: what it asks the network for, and what it says.

The page gets a script that counts errors and looks at its images, and writes what it found into the
document, which Chromium prints.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

_PROBE = """<script>
window.mistakes = [];
const note = (event) => window.mistakes.push(String(event.message || event.target.src));
window.addEventListener("error", note, true);
window.addEventListener("load", () => {
  %(script)s
  const found = {
    mistakes: window.mistakes,
    images: Array.from(document.images, (i) => [i.naturalWidth, i.naturalHeight, i.alt]),
    requests: performance.getEntriesByType("resource").map((r) => r.name)
      .filter((name) => !name.startsWith("data:")),
    wide: document.documentElement.scrollWidth - window.innerWidth,
    answer: window.answer,
  };
  const probe = document.createElement("pre");
  probe.id = "probe"; probe.textContent = JSON.stringify(found);
  document.body.append(probe);
});
</script>"""


def browser():
    """The path of a Chromium; the test is skipped without one."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the PATH")
    return found


def opened(page, folder, script="", width=1200):
    """What the page, a text, is like once it is loaded; `script` may set ``window.answer``.

    Headless Chromium has no network here but the one that the page would ask for, which counts.
    """
    program = browser()
    assert "<head>" in page
    file = folder / "probed.html"
    file.write_text(page.replace("<head>", "<head>" + _PROBE % {"script": script}, 1), "utf-8")
    options = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")
    done = subprocess.run(
        [
            program,
            *options,
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={width},900",
            "--virtual-time-budget=5000",
            "--dump-dom",
            file.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert found, f"{program} printed no probe: {done.returncode}\n{done.stderr[-2000:]}"
    return json.loads(unescape(found[1]))


def references(page):
    """Addresses that a page would load or link beside those within it, and calls that load."""
    own = re.sub(r"""["'](data:|#)[^"']*["']""", "''", page)
    scripts = "".join(re.findall(r"<script.*?</script>", own, re.S))
    plain = re.sub(r"(<script[^>]*>).*?</script>", r"\1", own, flags=re.S)
    loads = re.findall(
        r"""\s(?:src|href|action|poster|srcset|data)\s*=\s*["']?([^"'\s>]+)""", plain
    )
    styles = re.findall(r"url\(([^)]*)\)|@import\s+([^;]+)", plain)
    calls = re.findall(r"https?:|fetch\(|XMLHttpRequest|import\(|WebSocket|sendBeacon", scripts)
    return [*loads, *(part for pair in styles for part in pair if part), *calls]
