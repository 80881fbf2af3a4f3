"""Check that a wheel holds every module and data file of the checkout, and nothing else."""

import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HOMES = {"casswarm": "casswarm", "problems": "casswarm/problems", "cli": "casswarm/cli"}


def expected() -> set[str]:
    """Names that the wheel must hold besides its metadata."""
    return {
        f"{home}/{path.relative_to(ROOT / folder).as_posix()}"
        for folder, home in HOMES.items()
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and path.parent.name != "__pycache__"
    }


def main(wheel: str) -> int:
    """Print the differences; 0 if there are none."""
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    required = expected()
    for label, difference in (("missing", required - names), ("unexpected", names - required)):
        for name in sorted(difference):
            print(f"{label}: {name}")
    print(f"{Path(wheel).name}: {len(names)} files")
    return int(names != required)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
