"""``python -m casswarm``: the command line."""

from .cli import main

main()
