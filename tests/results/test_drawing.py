"""Figures drawn in two processes: the same files, in the same order, with the same errors."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from casswarm.results import FigureFormat
from casswarm.results.drawing import FigureProcess, drawn_files

SMALL = FigureFormat(dpi=40)


def line(height: float) -> Figure:
    fig = Figure(figsize=(2, 1))
    fig.subplots().plot([0, height])
    return fig


def line_here(height: float, process: int) -> Figure:
    if os.getpid() != process:
        raise RuntimeError("not in this process")
    return line(height)


def leave_elsewhere(height: float, process: int) -> Figure:
    if os.getpid() != process:
        os._exit(3)
    return line(height)


def refuse() -> Figure:
    raise ValueError("nothing to draw")


@pytest.fixture
def helper() -> Iterator[FigureProcess]:
    process = FigureProcess()
    end = time.monotonic() + 60
    while not process.is_free and time.monotonic() < end:
        time.sleep(0.02)
    yield process
    process.close()


def test_files_and_order_are_those_of_one_process(helper: FigureProcess) -> None:
    catalogue = {f"line-{k}": partial(line, k) for k in range(6)}
    reports: list[tuple[str, int, int]] = []
    alone = list(drawn_files(catalogue, SMALL))
    shared = list(drawn_files(catalogue, SMALL, helper, lambda *report: reports.append(report)))
    assert shared == alone
    assert [name for name, _ in alone] == list(catalogue)
    assert len({content for _, content in alone}) == 6
    counts = [done for _, done, _ in reports]
    assert counts == sorted(counts)
    assert reports[-1] == ("drawing figures", 6, 6)


@pytest.mark.slow
@pytest.mark.parametrize("draw", [line_here, leave_elsewhere])
def test_figures_that_the_helper_cannot_draw_are_drawn_here(helper: FigureProcess, draw) -> None:
    catalogue = {f"line-{k}": partial(draw, k, os.getpid()) for k in range(4)}
    expected = {f"line-{k}": SMALL.file_content(partial(line, k)) for k in range(4)}
    assert dict(drawn_files(catalogue, SMALL, helper)) == expected
    assert not helper.is_free


@pytest.mark.slow
def test_figures_that_do_not_pickle_are_drawn_here(helper: FigureProcess) -> None:
    with Path(os.devnull).open() as opened:
        catalogue = {name: lambda: line(opened.fileno() > 0) for name in "abc"}
        assert [name for name, _ in drawn_files(catalogue, SMALL, helper)] == list("abc")


@pytest.mark.slow
def test_an_error_of_a_figure_is_raised(helper: FigureProcess) -> None:
    catalogue = {"line": partial(line, 1), "none": refuse}
    for chosen in (None, helper):
        with pytest.raises(ValueError, match="nothing to draw"):
            list(drawn_files(catalogue, SMALL, chosen))
