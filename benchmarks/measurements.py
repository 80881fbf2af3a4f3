"""Tables of measurements in the documentation: which are older than the code they measure.

Run in a checkout, with the installed package::

    python benchmarks/measurements.py                     # a line for every table
    python benchmarks/measurements.py --check             # fails if a table is too old, as in CI
    python benchmarks/measurements.py joint-bound chain-coverage    # make these tables again

``docs/measured/tables.toml`` has the command of every table, and the files and folders whose code
it measures. What the command prints is ``docs/measured/NAME.inc``, which a page includes, below the
command, the day, and a fingerprint of that code and of the script: of their lines without
docstrings, comments and blanks. Where there are other lines now, the table is too old.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

from structure import ROOT, code

TABLES = ROOT / "docs" / "measured"


class Table(NamedTuple):
    """A table: its name, the command that prints it, and the paths of the code it measures."""

    name: str
    command: str
    code: list[str]

    @property
    def path(self) -> Path:
        """The file that pages include."""
        return TABLES / f"{self.name}.inc"

    @property
    def made_from(self) -> str:
        """Fingerprint of the code that the table was made from; empty if there is no table."""
        text = self.path.read_text(encoding="utf-8") if self.path.exists() else ""
        found = re.match(r"<!-- code (\w+) -->\n", text)
        return found[1] if found else ""

    @property
    def sources(self) -> list[str]:
        """The code that it measures, and the script that measures."""
        return [*self.code, *re.findall(r"benchmarks/\w+\.py", self.command)]

    @property
    def current(self) -> bool:
        """True if the table is of the code as it is."""
        return self.made_from == fingerprint(self.sources)

    def make(self) -> None:
        """Run the command, and keep what it prints."""
        before = fingerprint(self.sources)
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        done = subprocess.run(
            self.command,
            shell=True,  # it may set variables
            cwd=ROOT,
            env=os.environ | {"PATH": path},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        day = datetime.datetime.now(tz=datetime.UTC).date()
        self.path.write_text(
            f"<!-- code {before} -->\n`{self.command}`, {day}:\n\n{done.stdout.strip()}\n",
            encoding="utf-8",
        )


def tables() -> list[Table]:
    """All tables, by name."""
    text = (TABLES / "tables.toml").read_text(encoding="utf-8")
    return [Table(name, **entry) for name, entry in sorted(tomllib.loads(text).items())]


def fingerprint(paths: list[str], root: Path = ROOT) -> str:
    """Twelve digits that change with any line of code in these files and folders."""
    found = hashlib.sha256()
    for each in sorted(paths):
        if not (root / each).exists():
            raise FileNotFoundError(f"{TABLES / 'tables.toml'}: there is no {each}")
        files = [root / each] if (root / each).is_file() else sorted((root / each).rglob("*.py"))
        for file in files:
            lines = [file.relative_to(root).as_posix(), *code(file)]
            found.update("\n".join([*lines, ""]).encode())
    return found.hexdigest()[:12]


def main() -> int:
    """Check, list or make tables; the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="tables to be made again")
    parser.add_argument("--check", action="store_true", help="fail if a table is too old")
    options = parser.parse_args()
    known = {table.name: table for table in tables()}
    if unknown := set(options.names) - set(known):
        parser.error(f"unknown table {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    for name in options.names:
        known[name].make()
    if not options.check:
        for table in known.values():
            print(f"{table.name:24} {'current' if table.current else 'too old':8} {table.command}")
        return 0
    old = [table for table in known.values() if not table.current]
    for table in old:
        print(
            f"{table.path.relative_to(ROOT)} is older than {', '.join(table.sources)}: "
            f"python benchmarks/measurements.py {table.name}",
            file=sys.stderr,
        )
    return int(bool(old))


if __name__ == "__main__":
    sys.exit(main())
