"""Objects by name, whose modules are imported when they are first used.

So a room can offer what rooms above it, or packages outside casswarm, define.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import TypeVar

Value = TypeVar("Value")

_ANNOUNCED: list[tuple[str, str, str, str | None]] = []


def announce(kind: str, name: str, target: str, before: str | None = None) -> None:
    """Add an entry to the registry of a kind, when that is made, after its own entries."""
    _ANNOUNCED.append((kind, name, target, before))


class Registry(Mapping[str, Value]):
    """Objects by name, imported when they are looked up, in the order of registration.

    Parameters
    ----------
    kind : str
        What they are, in messages.
    error : callable
        The error of a message and a name.
    **targets : str
        Its own entries; then follow those of `announce`.
    """

    def __init__(self, kind: str, error: Callable[[str, str], Exception], **targets: str) -> None:
        self._kind, self._error, self.targets = kind, error, targets
        for place, name, target, before in _ANNOUNCED:
            if place == kind:
                self.add(name, target, before)

    def __getitem__(self, name: str) -> Value:
        module, _, attribute = self.targets[name].partition(":")
        value: Value = getattr(import_module(module), attribute)
        return value

    def __iter__(self) -> Iterator[str]:
        return iter(self.targets)

    def __len__(self) -> int:
        return len(self.targets)

    def add(self, name: str, target: str, before: str | None = None) -> None:
        """Add ``"module:name"`` before another entry, or as the last; the error if it is taken."""
        known = self.targets.get(name, target)
        if known != target:
            raise self._error(f"{self._kind} {name!r} is {known} already; got {target}", name)
        if name in self.targets:
            return
        entries = list(self.targets.items())
        place = list(self.targets).index(before) if before in self.targets else len(entries)
        self.targets = dict([*entries[:place], (name, target), *entries[place:]])
