"""Size and structure of the source: lines, files, imports, tests, and kernels written as text.

Run in a checkout::

    python benchmarks/structure.py                  # the table
    python benchmarks/structure.py --check          # exit status 1 if the code has grown, as in CI
    python benchmarks/structure.py --walks          # rooms and modules on the way of three calls
    python benchmarks/structure.py --picture F.svg  # rooms, with their imports

Lines of code proper are those without docstrings, comments and blanks. They may exceed `REACHED` by
3 %; beyond that, CHANGELOG.md has to say why, in a line of its newest version of the form
``- Size: 27,000 lines of code, because ...``.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("casswarm", "cli", "problems")
REACHED, GROWTH = 29_058, 1.03
KERNEL_TEXT = re.compile(r"(^|\n)(@\w*kernel\n|@objective\n|def \w+\()")
UNUSUAL = {"__init__", "__main__", "base"}


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    found = {}
    for path in (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))):
        parts = list(path.relative_to(ROOT).with_suffix("").parts)
        parts = parts if parts[0] == "casswarm" else ["casswarm", *parts]
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def tree(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def code(path: Path) -> list[str]:
    """Lines with code: no docstring, no comment, no blank line."""
    text = path.read_text(encoding="utf-8")
    ignored = {
        *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
        *(tokenize.ENCODING, tokenize.ENDMARKER),
    }
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in ignored:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return [line for number, line in enumerate(text.splitlines(), start=1) if number in lines]


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """Modules that a module imports, also inside functions, but not for its types only."""
    types_only = {
        id(each)
        for node in ast.walk(tree(path))
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for each in ast.walk(node)
    }
    found: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom) and id(node) not in types_only:
            base = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
            base = base[: len(base) - max(node.level - 1, 0)] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{origin}.{alias.name}"
                found.update({full} if full in known else {origin} & known.keys())
    return found - {name, "casswarm"}


def graph() -> dict[str, set[str]]:
    """Imports of every module."""
    known = modules()
    return {name: imports(name, path, known) for name, path in known.items()}


def circles(edges: dict[str, set[str]]) -> list[set[str]]:
    """Strongly connected components of more than one module."""
    reach: dict[str, set[str]] = {}
    for start in edges:
        seen, waiting = set(), [start]
        while waiting:
            for other in edges.get(waiting.pop(), ()):
                if other not in seen:
                    seen.add(other)
                    waiting.append(other)
        reach[start] = seen
    rings = {
        frozenset(other for other in reach[name] if name in reach[other])
        for name in edges
        if name in reach[name]
    }
    return [set(ring) for ring in rings if len(ring) > 1]


def strings(path: Path) -> list[str]:
    """Texts in a file."""
    constants = (node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Constant))
    return [value for value in constants if isinstance(value, str)]


def room(module: str) -> str:
    """Room of a module: the second part of its name."""
    return [*module.split("."), ""][1]


def below_face(path: Path) -> tuple[int, int]:
    """Imports from casswarm in a file of tests: those below a room's face, and all."""
    rooms = {folder.name for folder in (ROOT / "casswarm").iterdir() if folder.is_dir()}
    origins = [
        node.module
        for node in ast.walk(tree(path))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("casswarm")
    ]
    deep = [each for each in origins if each.count(".") >= 2 and room(each) in rooms]
    return len(deep), len(origins)


def numbers() -> dict[str, str]:
    """The rows of the table."""
    paths = list(modules().values())
    tests = sorted((ROOT / "tests").rglob("*.py"))
    deep, all_imports = map(sum, zip(*map(below_face, tests), strict=True))
    stems = Counter(path.stem for path in paths if path.stem not in UNUSUAL)
    texts = [path for path in paths if any(map(KERNEL_TEXT.search, strings(path)))]
    words = len((ROOT / "README.md").read_text(encoding="utf-8").split())
    return {
        "lines in casswarm, cli, problems": f"{total(paths):,}",
        "lines of code proper": f"{sum(len(code(path)) for path in paths):,}",
        "Python files": f"{len(paths)}",
        "lines of tests": f"{total(tests):,}",
        "file names used more than once": f"{sum(count > 1 for count in stems.values())}",
        "circles of imports": f"{len(circles(graph()))}",
        "test imports below a room's face": f"{deep / all_imports:.0%}",
        "modules with kernels as text": f"{len(texts)}",
        "words in README.md": f"{words:,}",
    }


def total(paths: list[Path]) -> int:
    """Number of lines of files."""
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def allowed() -> float:
    """The largest number of lines of code that passes the check."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = "".join(changelog.split("\n## ")[1:3])  # unreleased, and the last release
    stated = re.findall(r"^- Size: ([\d,]+) lines of code, because", newest, re.MULTILINE)
    return max([REACHED * GROWTH, *(int(each.replace(",", "")) for each in stated)])


def walks() -> dict[str, tuple[int, int]]:
    """Numbers of rooms and of modules whose functions three calls run, imports excluded."""
    import numpy as np

    import casswarm as csw

    scenario = csw.load_scenario("paper-1")
    guide = csw.plan(scenario, certify=False)
    policy = csw.make_policy("leader", scenario, guide=guide)
    points = np.array(scenario.swarm.positions)[None]
    arrays = points, np.zeros_like(points), np.ones(points.shape[:2], bool)
    calls = {
        "simulate": lambda: csw.simulate(scenario, ["leader"], runs=50, guide=guide),
        "plan": lambda: csw.plan(scenario),
        "a formation problem": lambda: policy.decide_batch(0, *arrays),
    }
    found = {}
    for name, call in calls.items():
        call()  # what is imported and compiled once
        seen: set[str] = set()
        sys.setprofile(lambda frame, *_: seen.add(frame.f_globals.get("__name__", "")))  # noqa: B023
        call()
        sys.setprofile(None)
        own = {each for each in seen if each.startswith("casswarm.")}
        found[name] = len({room(each) for each in own}), len(own)
    return found


def floors() -> dict[str, int]:
    """Floor of every room: above all rooms that it imports."""
    between: dict[str, set[str]] = defaultdict(set)
    for name, others in graph().items():
        between[room(name)] |= {room(other) for other in others} - {room(name), ""}
    level: dict[str, int] = {}

    def floor(name: str, path: tuple[str, ...] = ()) -> int:
        if name in path:
            raise SystemExit(f"a circle of rooms: {' -> '.join([*path, name])}")
        if name not in level:
            level[name] = 1 + max((floor(o, (*path, name)) for o in between[name]), default=0)
        return level[name]

    for name in list(between):
        floor(name)
    return {name: level[name] for name in sorted(level, key=lambda each: -level[each]) if name}


def steps() -> list[tuple[str, str]]:
    """Imports between rooms that do not follow from others, without what every room uses."""
    everywhere = {"", "__main__", "_util", "errors", "typing"}
    between: dict[str, set[str]] = defaultdict(set)
    for name, others in graph().items():
        between[room(name)] |= {room(other) for other in others} - {room(name)} - everywhere
    below: dict[str, set[str]] = {}
    for name in reversed(floors()):
        below[name] = between[name].union(*(below.get(other, set()) for other in between[name]))
    return [
        (name, other)
        for name, others in sorted(between.items())
        for other in sorted(others)
        if name not in everywhere and not any(other in below[each] for each in others)
    ]


def draw(target: Path) -> None:
    """Draw the rooms by floors, with the imports of `steps`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    pairs = steps()
    rows: dict[int, list[str]] = defaultdict(list)
    for name, floor in floors().items():
        if any(name in pair for pair in pairs):
            rows[floor].append(name)
    place = {
        name: ((k - (len(names) - 1) / 2) * 1.4 + 0.3 * (floor % 3 - 1), floor)
        for floor, names in rows.items()
        for k, name in enumerate(sorted(names))
    }
    figure, axes = plt.subplots(figsize=(7, 10))
    for upper, lower in pairs:
        style = {"arrowstyle": "->", "color": "0.45", "shrinkA": 12, "shrinkB": 14}
        axes.annotate("", place[lower], place[upper], arrowprops=style)
    for name, (x, y) in place.items():
        box = {"boxstyle": "round", "facecolor": "white", "edgecolor": "0.3"}
        axes.text(x, y, name, ha="center", va="center", bbox=box)
    axes.set(xlim=(-2.2, 2.2), ylim=(min(rows) - 0.6, max(rows) + 0.6))
    axes.set_title("Rooms by floors, and their imports that do not follow from others")
    axes.set_axis_off()
    figure.savefig(target, bbox_inches="tight")


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="fail if the code has grown")
    parser.add_argument("--walks", action="store_true", help="rooms that three calls pass through")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw rooms and imports")
    options = parser.parse_args()
    for name, value in numbers().items():
        print(f"{name:36}{value:>9}")
    if options.walks:
        for name, (rooms, files) in walks().items():
            print(f"{name}: {rooms} rooms, {files} modules")
    if options.picture:
        draw(options.picture)
    size = sum(len(code(path)) for path in modules().values())
    if options.check and size > allowed():
        sys.exit(f"{size:,} lines of code; {allowed():,.0f} are allowed: see {Path(__file__).name}")


if __name__ == "__main__":
    main()
