"""The server of the local page under messages that no page sends; no process, no browser."""

from __future__ import annotations

import json
import socket
import time
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from small_scenarios import three_members

import casswarm as csw

pytest.importorskip("websockets", reason="needs the extra explore")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from casswarm.exploration import session as session_module
from casswarm.exploration.frontends import page_server
from casswarm.exploration.session import Session


class Silent:
    """In place of the worker."""

    def __init__(self, receive):
        self.receive = receive

    def ask(self, question):
        pass

    def close(self):
        pass


@pytest.fixture
def session(monkeypatch):
    monkeypatch.setattr(session_module, "Worker", Silent)
    return Session(three_members())


@pytest.fixture
def address(session):
    with page_server(session) as address:
        yield address


def page_of(address, **options):
    return connect(address.replace("http", "ws", 1) + "socket", **options)


def replies(page, number=1):
    """Messages until the one of this number is handled."""
    received = []
    while not received or received[-1].get("handled") != number:
        received.append(json.loads(page.recv(timeout=20)))
    return received


def moved(x, index=0):
    return f'{{"type": "move", "point": "radar", "index": {index}, "position": [{x}, 1.0]}}'


@pytest.mark.parametrize(
    "frame",
    [
        "[" * 60_000,
        "{",
        b"\xff\xfe\x00",
        '{"type": "undo", "number": NaN}',
        moved("1" + "0" * 400),
        moved("NaN"),
        moved("1e999"),
        moved(1.2, "Infinity"),
        moved(1.2, -1),
    ],
    ids=["nested", "cut", "binary", "number", "huge", "nan", "inf", "infinite-index", "negative"],
)
def test_malformed_message_changes_nothing_and_keeps_the_connection(session, address, frame):
    before = session.scenario
    with page_of(address) as page:
        page.send(frame)
        page.send('{"type": "redo", "number": 1}')
        assert replies(page)[-1] == {"handled": 1}
    assert session.scenario == before


def test_message_beyond_the_limit_closes_its_page_only(address):
    with page_of(address) as other, page_of(address) as page:
        page.send("x" * 70_000)
        with pytest.raises(ConnectionClosed, match="too big"):
            page.recv(timeout=20)
        other.send('{"type": "redo", "number": 1}')
        assert replies(other)


@pytest.mark.parametrize(
    ("path", "origin"),
    [("socket", "https://example.org"), ("socket", "null"), ("", "http://127.0.0.1:1")],
)
def test_websocket_of_another_origin_is_refused(address, path, origin):
    with pytest.raises(InvalidStatus, match="403"):
        page_of(address if path else address + "../", origin=origin)


def test_websocket_without_token_is_refused(address):
    host = address.split("/")[2]
    for path in ("socket", "/socket", "a" * 32 + "/socket"):
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{host}/{path}")


@pytest.mark.parametrize(
    "name", ["../page.html", "..%2fview.py", "page.html%00", "page.js?x", "//"]
)
def test_names_of_other_files_are_not_found(address, name):
    with pytest.raises(HTTPError, match="404"):
        urlopen(Request(address + name))


def test_burst_of_moves_is_handled_in_order_and_history_is_bounded(session, address, monkeypatch):
    monkeypatch.setattr(session_module, "MAX_MOMENTS", 50)
    first = session.scenario
    with page_of(address) as page:
        for number in range(1, 501):
            x = 1.2 + 0.001 * number
            message = json.loads(moved(x)) | {"number": number}
            page.send(json.dumps(message))
        replies(page, 500)
    assert session.scenario.hazard_table.radars[0] == pytest.approx((1.7, 1.0))
    steps = 0
    while session.history.can_undo:
        session.undo()
        steps += 1
    assert steps == 49
    assert session.scenario == first


def test_page_that_does_not_read_delays_neither_others_nor_the_end(session):
    with page_server(session) as address:
        _, _, host, token, _ = address.split("/")
        name, port = host.split(":")
        stalled = socket.create_connection((name, int(port)))
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.sendall(
            f"GET /{token}/socket HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert b"101" in stalled.recv(4096)
        stalled.sendall(frame('{"type": "open"}'))
        stalled.settimeout(2)
        try:
            for _ in range(20_000):
                stalled.sendall(frame('{"type": "copy"}'))
        except OSError:  # the server has closed its connection
            pass
        began = time.monotonic()
        with page_of(address) as page:
            page.send(json.dumps(json.loads(moved(1.3)) | {"number": 1}))
            assert replies(page)
        assert session.scenario.hazard_table.radars[0] == (1.3, 1.0)
        answered = time.monotonic()
    times = answered - began, time.monotonic() - answered
    assert max(times) < 8, times  # websockets waits 10 s for a page that is to be closed
    stalled.close()


def frame(text):
    """A masked text frame of less than 126 bytes."""
    return bytes([0x81, 0x80 | len(text)]) + bytes(4) + text.encode()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("name", "other"),
        ("description", "<img src=x>"),
        ("hazard.collision", "os:system"),
        ("time.dt", 1e-9),
        ("n", 10**9),
        ("n", float("nan")),
    ],
)
def test_page_changes_only_what_it_shows(session, address, key, value):
    before = session.scenario
    with page_of(address) as page:
        message = {"type": "change", "key": key, "value": value, "number": 1}
        page.send(json.dumps(message))
        notice = replies(page)[0]["notice"]
    assert "load it again" in notice or "whole numbers from 1 to 1000" in notice
    assert session.scenario == before


def test_save_does_not_follow_a_link(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small-explored.toml").symlink_to("elsewhere.toml")
    path = session.save()
    assert path.name == "small-explored-2.toml"
    assert not (tmp_path / "elsewhere.toml").exists()
    for number in range(3, 1000):
        (tmp_path / f"small-explored-{number}.toml").touch()
    with pytest.raises(csw.ScenarioError, match=r"999 files small-explored\*\.toml"):
        Session(three_members()).save()
