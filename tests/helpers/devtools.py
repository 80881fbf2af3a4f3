"""Headless Chromium that a test drives, through the DevTools protocol: pages, input, requests."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--remote-debugging-port=0",
)


class Page:
    """A page: expressions are evaluated in it, the pointer and the keyboard act on it."""

    def __init__(self, socket):
        self._socket, self._number = socket, 0
        self.requests, self.errors = [], []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=60))
            self._note(answer)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def _note(self, event):
        method, values = event.get("method"), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(values["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(values["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(values["exceptionDetails"])
        elif method == "Log.entryAdded" and values["entry"]["level"] == "error":
            self.errors.append(values["entry"])

    def open(self, address):
        self.call("Page.navigate", url=address)

    def value(self, expression):
        """Value of a JavaScript expression; promises are awaited."""
        result = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait(self, expression, seconds=60):
        """Wait until an expression is truthy, and return its value."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if value := self.value(expression):
                return value
            time.sleep(0.02)
        raise AssertionError(f"never true: {expression}\n{self.value('document.body.innerText')}")

    def center(self, selector):
        """Centre of an element, in pixels of the window."""
        return self.value(
            f"(() => {{ const b = document.querySelector({selector!r}).getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )

    def mouse(self, kind, x, y):
        pressed = kind != "mouseReleased"
        self.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button="left",
            buttons=int(pressed),
            clickCount=int(kind != "mouseMoved"),
        )

    def click(self, selector):
        x, y = self.center(selector)
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)

    def drag(self, selector, to, steps=5):
        """Drag an element to a position in pixels of the window."""
        x, y = self.center(selector)
        self.mouse("mousePressed", x, y)
        for k in range(1, steps + 1):
            self.mouse("mouseMoved", x + k * (to[0] - x) / steps, y + k * (to[1] - y) / steps)
            time.sleep(0.02)
        self.mouse("mouseReleased", *to)

    def touch(self, selector, to, steps=5):
        """Drag an element with a finger."""
        x, y = self.center(selector)
        self.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        for k in range(1, steps + 1):
            point = {"x": x + k * (to[0] - x) / steps, "y": y + k * (to[1] - y) / steps}
            self.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[point])
            time.sleep(0.02)
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def key(self, key, modifiers=0):
        """Press a key; modifiers: 1 Alt, 2 Ctrl, 4 Meta, 8 Shift."""
        codes = {"Tab": 9, "Enter": 13, " ": 32, "ArrowLeft": 37, "ArrowUp": 38}
        codes |= {"ArrowRight": 39, "ArrowDown": 40}
        values = {"key": key, "modifiers": modifiers}
        values["windowsVirtualKeyCode"] = codes.get(key, ord(key.upper()[0]))
        text = {"Enter": "\r", " ": " "}.get(key)
        self.call(
            "Input.dispatchKeyEvent", type="keyDown", **values, **({"text": text} if text else {})
        )
        self.call("Input.dispatchKeyEvent", type="keyUp", **values)

    def phone(self, width=360, height=740):
        """Make the window that of a phone, with a touch screen."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2,
            mobile=True,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=True)

    def screenshot(self, path, selector="html"):
        """Write a picture of an element as PNG."""
        box = self.value(f"document.querySelector({selector!r}).getBoundingClientRect().toJSON()")
        clip = {name: box[name] for name in ("x", "y", "width", "height")} | {"scale": 1}
        picture = self.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        Path(path).write_bytes(base64.b64decode(picture["data"]))


def browser():
    """The path of a Chromium; the test is skipped without one."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the PATH")
    return found


@contextmanager
def opened_page(folder, width=1100, height=900):
    """An empty page in a Chromium of its own; the test is skipped without one."""
    from websockets.sync.client import connect

    profile = folder / "profile"
    process = subprocess.Popen(
        [browser(), *_OPTIONS, f"--user-data-dir={profile}", f"--window-size={width},{height}"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        port = _first_line(profile / "DevToolsActivePort", process)
        with connect(_page_address(port), max_size=None, compression=None) as socket:
            yield Page(socket)
    finally:
        process.terminate()
        process.wait(20)


def _first_line(file, process):
    for _ in range(1500):
        if file.exists() and "\n" in (text := file.read_text()):
            return int(text.splitlines()[0])
        assert process.poll() is None, f"Chromium ended with {process.returncode}"
        time.sleep(0.02)
    raise AssertionError("Chromium did not start")


def _page_address(port):
    from urllib.request import urlopen

    with urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
        targets = json.load(answer)
    return next(target["webSocketDebuggerUrl"] for target in targets if target["type"] == "page")


_SEEN = """(() => {
  %s
  return {
    images: Array.from(document.images, (i) => [i.naturalWidth, i.naturalHeight, i.alt]),
    wide: document.documentElement.scrollWidth - window.innerWidth,
    answer: window.answer,
  };
})()"""


def opened(page, folder, script="", width=1200):
    """What the page, a text, is like once it is loaded; `script` may set ``window.answer``."""
    file = folder / "opened.html"
    file.write_text(page, "utf-8")
    with opened_page(folder, width) as chromium:
        chromium.open(file.as_uri())
        chromium.wait("location.protocol === 'file:' && document.readyState === 'complete'")
        seen = chromium.value(_SEEN % script)
        own = ("data:", "chrome:", file.as_uri())  # chrome: of the empty page before
        asked = [url for url in chromium.requests if not url.startswith(own)]
        return seen | {"mistakes": chromium.errors, "requests": asked}


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
