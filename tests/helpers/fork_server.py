"""A process that has imported casswarm, and forks a process for every command it is asked to run.

Most of the time of a short command is that of its imports. Each command has a process of its own
nevertheless, with its own folder, environment, output and exit code. Requests are lines of JSON on
standard input; the answer to each is the exit code on standard output.
"""

import atexit
import importlib
import json
import os
import sys
import traceback

PRELOADED = (
    "casswarm.cli",
    "casswarm.reproduction.reproduce",
    "casswarm.results.folder",
    "casswarm.studies.sweep",
    "casswarm.joint.search",
    "casswarm.formation.projected_gradient",
    "casswarm.figures.animation",
    "casswarm.figures.success",
    "jinja2",
    "scipy.optimize",
)
"""Modules that commands import: none starts threads or computes."""


def run(request):
    """Run a command in this process; its exit code."""
    from casswarm.cli import main

    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    if request["failing"]:
        fail(*request["failing"])
    for number, name in enumerate(("input", "output", "error")):
        flags = os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        os.dup2(os.open(request[name], flags), number)
    sys.argv = ["casswarm", *request["arguments"]]
    try:
        main()
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def serve():
    """Answer requests until there are no more."""
    for name in PRELOADED:
        importlib.import_module(name)
    for line in sys.stdin:
        process = os.fork()
        if not process:
            code = run(json.loads(line))
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)


if __name__ == "__main__":  # and not where a worker of a command imports this file
    from failing_ending import fail

    sys.path.pop(0)  # this file's folder, which no command sees
    serve()
