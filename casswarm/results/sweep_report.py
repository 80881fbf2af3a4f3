"""A sweep as one self-contained HTML page, whose sliders choose among the computed points."""

from __future__ import annotations

import json
import shlex

from .._util.documents import json_text, render
from .folder import ResultsFolder

_NUMBERS = ("success_low", "success_high", "survivors_mean", "guide_survival")


def sweep_page(folder: ResultsFolder) -> str:
    """HTML page of a folder that casswarm sweep wrote.

    Raises
    ------
    CheckpointError
        The folder lacks its table.
    """
    record, table = folder.record, folder.table("sweep")
    rows = table.to_dict("records")
    settings = {
        key: list(dict.fromkeys(str(row[key]) for row in rows)) for key in folder.objects["keys"]
    }
    points = [
        {
            "at": [values.index(str(row[key])) for key, values in settings.items()],
            "policy": row["policy"],
            "failure": "" if row["status"] == "ok" else str(row["reason"]),
            **{name: row[name] for name in _NUMBERS},
        }
        for row in rows
    ]
    data = {
        "keys": [{"key": key, "values": values} for key, values in settings.items()],
        "policies": list(dict.fromkeys(table["policy"])),
        "points": points,
    }
    return render(
        "sweep.html",
        scenario=folder.scenario,
        method="95 % intervals" if table["method"].eq("sampled").all() else "proven bounds",
        points=len(points),
        data=json.loads(json_text(data)),
        command=f"casswarm {shlex.join(map(str, record['arguments']))}",
        version=record["versions"]["casswarm"],
    )
