"""The process that answers: what it is asked, how it ends, and with whom."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from queue import SimpleQueue

import pytest

from casswarm._util.child import Channel, Child, ChildEndedError, ChildTimeoutError


def obey(channel: Channel) -> None:
    for request in channel.requests():
        match request:
            case b"exit":
                print("so long", flush=True)
                os._exit(3)
            case b"sleep":
                time.sleep(60)
        channel.send(request.upper())


def test_child_answers_until_it_ends(tmp_path: Path) -> None:
    output = tmp_path / "output"
    output.touch()
    child = Child(obey, output)
    assert child.ask(b"word", 60) == b"WORD"
    if os.name == "posix":
        os.kill(child.process.pid or 0, signal.SIGINT)  # which is its parent's
    assert child.ask(b"other", 60) == b"OTHER"
    with pytest.raises(ChildEndedError, match=r"exit code 3; the last .* printed: so long"):
        child.ask(b"exit", 60)
    child.end()


def test_late_child_is_ended_by_its_parent() -> None:
    child = Child(obey)
    assert child.ask(b"word", 60) == b"WORD"
    with pytest.raises(ChildTimeoutError, match=r"no answer within 0\.1 s"):
        child.ask(b"sleep", 0.1)
    child.end()
    assert not child.process.is_alive()


def test_listener_hears_answers_in_order_and_the_end() -> None:
    child = Child(obey)
    heard: SimpleQueue[bytes] = SimpleQueue()
    child.listen(heard.put)
    for request in (b"a", b"b", b"exit"):
        child.send(request)
    assert [heard.get(timeout=60) for _ in range(3)] == [b"A", b"B", b""]
    child.end()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_child_ends_with_its_parent() -> None:
    code = (
        "from casswarm._util.child import Child; from test_child import obey; import time\n"
        "if __name__ == '__main__':\n"
        "    child = Child(obey); child.ask(b'word', 60)\n"
        "    print(child.process.pid, flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=Path(__file__).parent, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.kill()
    end = time.monotonic() + 20
    while Path(f"/proc/{pid}").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}").exists()
