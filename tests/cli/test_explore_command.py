"""casswarm explore: a page for this computer alone, which Ctrl-C ends."""

from __future__ import annotations

import signal
import subprocess
from contextlib import contextmanager
from http import HTTPStatus
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from commands import CASSWARM


@contextmanager
def exploring(folder, *arguments):
    """The address of a page, and the process that serves it."""
    pytest.importorskip("websockets", reason="needs the extra explore")
    command = [CASSWARM, "explore", "single-agent", "--no-browser", *arguments]
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield process.stdout.readline().strip(), process
    finally:
        process.kill()
        process.communicate()


def status(address, **headers):
    try:
        with urlopen(Request(address, headers=headers)) as answer:
            return answer.status
    except HTTPError as error:
        return error.code


@pytest.mark.slow
def test_page_needs_token_and_own_host_and_ends_with_interrupt(tmp_path):
    with exploring(tmp_path) as (address, process):
        scheme, _, host, token, _ = address.split("/")
        assert scheme == "http:"
        assert host.startswith("127.0.0.1:")
        assert len(token) >= 32
        with urlopen(address) as answer:
            page, policy = answer.read().decode(), answer.headers["Content-Security-Policy"]
        assert "page.js" in page
        assert policy.startswith("default-src 'none'")
        for name in ("explore.js", "explore.css", "page.js", "page.css"):
            assert status(address + name) == HTTPStatus.OK
        assert status(address + "server.py") == HTTPStatus.NOT_FOUND
        assert status(f"http://{host}/") == HTTPStatus.FORBIDDEN
        assert status(f"http://{host}/{'a' * len(token)}/") == HTTPStatus.FORBIDDEN
        assert status(address, Host="example.org") == HTTPStatus.FORBIDDEN
        assert status(address, Origin="https://example.org") == HTTPStatus.FORBIDDEN
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        assert process.returncode == 0
        assert "Traceback" not in said
        assert said.endswith("ended\n")
