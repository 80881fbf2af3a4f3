"""Files that are no scenario files are refused before they are read or parsed."""

from __future__ import annotations

import os
import re
import time

import pytest
from commands import casswarm

from casswarm import ScenarioError, load_scenario
from casswarm.scenario.scenario_files import MAX_BYTES, MAX_KEY_PARTS

POSIX = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs fifos and devices")


@POSIX
def test_fifo_without_writer_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    done = casswarm(tmp_path, "scenarios", "check", "pipe.toml", code=2)
    assert "pipe.toml cannot be read: it is a fifo, a socket or a device" in done.stderr


@POSIX
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null"])
def test_device_is_refused(tmp_path, device):
    done = casswarm(tmp_path, "plan", device, code=2)
    assert f"{device} cannot be read: it is a fifo, a socket or a device" in done.stderr


def test_large_file_is_refused(tmp_path):
    file = tmp_path / "large.toml"
    file.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(ScenarioError, match=r"it has 1,000,001 bytes, more than .* 1,000,000"):
        load_scenario(file)


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 300) + " = 1",
        "[" + " . ".join(['"a"'] * 300) + "]",
        "x = { " + ".".join(["'a'"] * 300) + " = 1 }",
    ],
)
def test_key_of_hundreds_of_parts_is_refused(tmp_path, text):
    file = tmp_path / "deep.toml"
    file.write_text(text)
    words = re.escape(f"a key in it has more than {MAX_KEY_PARTS} dotted parts")
    with pytest.raises(ScenarioError, match=words):
        load_scenario(file)


@pytest.mark.parametrize("text", ["a" * 900_000, "a." * 9 + "a" * 900_000, "'" * 900_000])
def test_search_for_long_keys_takes_linear_time(tmp_path, text):
    file = tmp_path / "word.toml"
    file.write_text(text)
    started = time.monotonic()
    with pytest.raises(ScenarioError):
        load_scenario(file)
    assert time.monotonic() - started < 30
