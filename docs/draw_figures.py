"""Draw the pictures of the documentation with the commands of docs/figures.md.

    python docs/draw_figures.py                      # all of them, in a few minutes
    python docs/draw_figures.py mpc evaluate-ring  # those of these results folders

casswarm must be installed.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd

from casswarm.figures import save, success_chart
from casswarm.results.folder import ResultsFolder

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
CASSWARM = Path(sys.executable).parent / "casswarm"

MPC = [word for name in ("leader", "leader-mpc-3", "leader-mpc-8") for word in ("--policy", name)]
ANYWHERE = ["--search", "global", "--arrival", "any"]
DISC = "{center = [8.0, 10.9], radius = 0.6, rate = 20.0, edge = 0.4}"
TRIANGLE = "{vertices = [[2.2, 9.3], [3.2, 9.3], [2.7, 10.3]], rate = 10.0, edge = 0.3}"
NORTH = "{center = [0.0, 13.0], radius = 0.7}"
COMMANDS = {
    "plan-paper-1": ["plan", "paper-1", "--map"],
    "descent": ["plan", "paper-1", "--solver", "projected-gradient"],
    "joint": ["plan-swarm", "paper-1"],
    "joint-paper-2": ["plan-swarm", "paper-2"],
    "simulate-paper-1": ["simulate", "paper-1", "--save-trajectories", "100"],
    "simulate-paper-2": [
        *("simulate", "paper-2", "--policy", "leader"),
        *("--save-trajectories", "100", "--runs", "100"),
    ],
    "mpc": ["simulate", "wall", *MPC, "--runs", "500"],
    "evaluate-ring": ["evaluate", "ring"],
    "sweep-n": ["sweep", "paper-1", "--set", "n=2,3,4,5,6"],
    "sweep-paper-1": [
        *("sweep", "paper-1", "--set", "n=2,4,6", "--set", "spacing=0.2,0.5,1.0"),
        *("--runs", "300"),
    ],
    "plan-blink": ["plan", "blink"],
    "two-gaps": ["plan", "two-gaps", "--ambiguity", "worst"],
    "two-gaps-joint": ["plan-swarm", "two-gaps", "--ambiguity", "worst"],
    "two-gaps-swarm": [
        *("evaluate", "two-gaps", "--policy", "naive", "--policy", "leader"),
        *("--policy", "constrained", "--policy", "joint", "--information"),
    ],
    "plan-zones": ["plan", "paper-1", *ANYWHERE, "--set", f"hazard.zone=[{DISC}, {TRIANGLE}]"],
    "plan-targets": ["plan", "paper-1", *ANYWHERE, "--set", f"target.other=[{NORTH}]"],
    "plan-disc": ["plan", "paper-1", *ANYWHERE, "--set", "swarm.speed=disc"],
    "arrivals": [
        *("sweep", "gauntlet", "--set", "success.arrivals=1,2,3,4,5"),
        *("--policy", "leader", "--policy", "constrained", "--policy", "joint"),
    ],
    "companions": ["plan-swarm", "companions"],
    "delay": [
        *("sweep", "gauntlet", "--set", 'information.delay=0,1,2,3,5,10,"never"', "--runs", "2000"),
        *("--policy", "leader", "--policy", "constrained", "--policy", "joint"),
    ],
    "substeps": [
        *("sweep", "alley", "--set", "time.substeps=1,2,4,8"),
        *("--policy", "leader", "--policy", "constrained"),
    ],
    "compare": ["compare", "--family", "quick", "--time-limit", "10"],
}
"""Commands by the name of their results folder."""

FIGURES = {
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
    "evaluate-ring": ("arrival", "population", "survival"),
    "sweep-n": ("over-n",),
    "sweep-paper-1": ("over-spacing", "heat-map"),
    "plan-blink": ("guide",),
    "two-gaps": ("mixture",),
    "two-gaps-joint": ("mixture",),
    "two-gaps-swarm": ("information",),
    "plan-zones": ("guide",),
    "plan-targets": ("guide",),
    "plan-disc": ("guide",),
    "arrivals": ("over-success-arrivals",),
    "companions": ("joint",),
    "delay": ("over-information-delay",),
    "substeps": ("over-time-substeps",),
    "compare": ("overview", "convergence-formations-cold"),
}
"""Figures of each results folder; the images are named FOLDER-FIGURE.png."""

OTHERS = {"joint-paper-2": ("joint", "joint.png")}
"""Figures with images of other names, for the README and other pages."""

ANIMATED = ("simulate-paper-1", "simulate-paper-2")


def run(folder: Path, *arguments: str) -> None:
    """Run casswarm in a folder."""
    print("casswarm", *arguments, flush=True)
    subprocess.run([CASSWARM, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def representative_run(folder: Path, policy: str = "leader") -> int:
    """First saved run in which leaders are lost and some members arrive; else the longest."""
    runs = ResultsFolder.open(folder).trajectories[policy]
    for number, trajectory in enumerate(runs):
        leaders = len(set(trajectory.leaders))
        alive = int(trajectory.alive[-1].sum())
        if leaders > 1 and 2 <= alive < trajectory.alive.shape[1] - 1:
            return number
    return max(range(len(runs)), key=lambda number: len(runs[number].alive))


def draw(folder: Path, source: str) -> None:
    """Run the command of a results folder, and draw its images."""
    run(folder, *COMMANDS[source], "--quiet", "--out", source)
    simulated = COMMANDS[source][0] == "simulate"
    chosen = ["--run", str(representative_run(folder / source))] if simulated else []
    images = {figure: f"{source}-{figure}.png" for figure in FIGURES.get(source, ())}
    images |= dict([OTHERS[source]]) if source in OTHERS else {}
    names = [word for figure in images for word in ("--figure", figure)]
    dpi = "150" if source in OTHERS else "100"
    drawn = f"drawn-{source}"
    run(folder, "plot", source, *names, *chosen, "--dpi", dpi, "--quiet", "--out", drawn)
    for figure, image in images.items():
        shutil.copy(folder / drawn / f"{figure}.png", IMAGES / image)
    if source in ANIMATED:
        options = ["--policy", "leader", *chosen, "--dpi", "68", "--fps", "10", "--quiet"]
        image = IMAGES / f"{source}.gif"
        image.unlink(missing_ok=True)  # casswarm keeps what others wrote
        run(folder, "animate", source, *options, "--out", str(image))


def main() -> None:
    """Draw the images of the results folders given as arguments, by default of all."""
    with tempfile.TemporaryDirectory() as name:
        for source in sys.argv[1:] or COMMANDS:
            draw(Path(name), source)
    if not sys.argv[1:]:
        policies = pd.read_csv(ROOT / "results" / "policies" / "policies.csv")
        save(success_chart(policies), IMAGES / "policies.png", dpi=130)
        shutil.copy(ROOT / "results" / "late-news" / "late-news.png", IMAGES)


if __name__ == "__main__":
    main()
