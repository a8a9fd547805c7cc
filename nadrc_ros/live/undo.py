"""The values of before, for who wants them back."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

Values = dict[str, Any]
_STEPS = 200


class Undo:
    """The values that a controller began with, and those before each change of the pages."""

    def __init__(self) -> None:
        self._start: Values = {}
        self._steps: deque[Values] = deque(maxlen=_STEPS)

    def begin(self, values: Mapping[str, Any]) -> None:
        """Take values for those of the start, unless these are known."""
        self._start = self._start or dict(values)

    def note(self, values: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        """Note that ``values`` replace those of ``now``."""
        before = {name: now[name] for name in values if name in now}
        if before:
            self._steps.append(before)

    def previous(self) -> Values:
        """Return the values before the last change, empty for none."""
        return dict(self._steps[-1]) if self._steps else {}

    def drop(self) -> None:
        """Forget the last change: it was undone."""
        self._steps.pop()

    def since_start(self, now: Mapping[str, Any]) -> Values:
        """Return those values of the start that are others now."""
        return {
            name: value for name, value in self._start.items() if now.get(name, value) != value
        }
