"""The command line in a process in which a later part of the work fails."""

import sys

from casswarm.cli import main

PLACES = {
    "bound": ("casswarm.planning.bounds.success_bound", "_bound"),
    "figures": ("casswarm.figures", "save"),
}
ERRORS = {"memory": MemoryError("no room"), "ctrl-c": KeyboardInterrupt(), "bug": KeyError("x")}


def run() -> None:
    """Run ``PLACE ERROR ARGUMENT...``: the command with an error raised at a place."""
    place, error, *arguments = sys.argv[1:]
    module, name = PLACES[place]

    def fail(*_: object, **__: object) -> None:
        raise ERRORS[error]

    __import__(module)
    setattr(sys.modules[module], name, fail)
    main(arguments, prog_name="casswarm")


if __name__ == "__main__":
    run()
