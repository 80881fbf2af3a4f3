"""Compare a wheel's contents with the checkout: every module and scenario in it, nothing else."""

import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SUFFIXES = {".py", ".pyi", ".toml", ".html", ".md", ".mplstyle"}
HOMES = {"casswarm": "casswarm", "problems": "casswarm/problems", "cli": "casswarm/cli"}


def expected() -> set[str]:
    """Names that the wheel must hold besides its metadata."""
    return {
        f"{home}/{path.relative_to(ROOT / folder).as_posix()}"
        for folder, home in HOMES.items()
        for path in (ROOT / folder).rglob("*")
        if path.suffix in SUFFIXES or path.name == "py.typed"
    }


def main(wheel: str) -> int:
    """Print the differences; 0 if there are none."""
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    files = expected()
    for word, difference in (("missing", files - names), ("unexpected", names - files)):
        for name in sorted(difference):
            print(f"{word}: {name}")
    print(f"{Path(wheel).name}: {len(names)} files")
    return int(names != files)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
