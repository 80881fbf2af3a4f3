"""Draw the pictures of docs/figures.md and the README, by the commands that docs/figures.md tells.

Run it where casswarm is installed: python docs/draw_figures.py. It takes about two minutes.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from casswarm.results.folder import Saved

IMAGES = Path(__file__).resolve().parent / "images"
CASSWARM = Path(sys.executable).parent / "casswarm"
SMALL = ("--dpi", "100", "--quiet")

AHEAD = tuple(
    word for name in ("leader", "leader-mpc-3", "leader-mpc-8") for word in ("--policy", name)
)
RUNS = (
    ("plan", "paper-1", "--map"),
    ("plan", "paper-1", "--solver", "projected-gradient", "--out", "results/descent"),
    ("plan-swarm", "paper-1", "--out", "results/joint"),
    ("simulate", "paper-1", "--save-trajectories", "100"),
    ("simulate", "paper-2", "--policy", "leader", "--save-trajectories", "100", "--runs", "100"),
    ("simulate", "wall", *AHEAD, "--runs", "500", "--out", "results/mpc"),
    ("evaluate", "paper-1"),
    ("sweep", "paper-1", "--set", "n=2,3,4,5,6", "--out", "results/sweep-n"),
    ("sweep", "paper-1", "--set", "n=2,4,6", "--set", "spacing=0.2,0.5,1.0", "--runs", "300"),
    ("compare", "--family", "quick", "--time-limit", "10"),
)
DRAWN = {
    "plan-paper-1": ("guide", "cost-to-go"),
    "descent": ("comparison",),
    "joint": ("joint",),
    "simulate-paper-1": (
        "success",
        "differences",
        "run-leader",
        "formation-leader",
        "formation-constrained",
    ),
    "simulate-paper-2": ("formation-leader",),
    "mpc": ("success", "run-leader", "run-leader-mpc-8"),
    "evaluate-paper-1": ("arrival", "population", "survival"),
    "sweep-n": ("over-n",),
    "sweep-paper-1": ("over-spacing", "heat-map"),
    "compare": ("profile-formations-cold",),
}
"""What is shown of which results folder."""


def run(folder: Path, *arguments: str) -> None:
    """A command in a folder."""
    print("casswarm", *arguments, flush=True)
    subprocess.run([CASSWARM, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def telling_run(folder: Path, policy: str = "leader") -> int:
    """The first kept run in which leaders are lost and some members arrive; else the longest."""
    kept = Saved.of(folder).trajectories[policy]
    for number, trace in enumerate(kept):
        leaders = len(set(trace.leaders))
        alive = int(trace.alive[-1].sum())
        if leaders > 1 and 2 <= alive < trace.alive.shape[1] - 1:
            return number
    return max(range(len(kept)), key=lambda number: len(kept[number].alive))


def main() -> None:
    """Run all commands in a temporary folder and keep the pictures."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        for arguments in RUNS:
            run(work, *arguments, "--quiet")
        for source, figures in DRAWN.items():
            results = work / "results" / source
            chosen = [part for figure in figures for part in ("--figure", figure)]
            kept = ("--run", str(telling_run(results))) if source.startswith("simulate") else ()
            run(work, "plot", f"results/{source}", *chosen, *kept, *SMALL, "--out", source)
            for figure in figures:
                shutil.copy(work / source / f"{figure}.png", IMAGES / f"{source}-{figure}.png")
        for source in ("simulate-paper-1", "simulate-paper-2"):
            number = str(telling_run(work / "results" / source))
            gif = IMAGES / f"{source}.gif"
            options = ("--policy", "leader", "--run", number, "--dpi", "90", "--quiet")
            run(work, "animate", f"results/{source}", *options, "--out", str(gif))
        one = ("--runs", "1", "--seed", "39", "--dpi", "150")
        run(work, "simulate", "paper-1", "--policy", "leader", *one)
        shutil.copy(work / "results" / "simulate-paper-1" / "run-leader.png", IMAGES / "leader.png")


if __name__ == "__main__":
    main()
