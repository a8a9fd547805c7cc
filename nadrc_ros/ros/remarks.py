"""What a node says of its surroundings: once in the log, on /diagnostics while it holds."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
import time

from nadrc_ros.ros.diagnostics import ERROR, OK, WARN
from rclpy.impl.rcutils_logger import RcutilsLogger

# What comes and goes is logged again after so many seconds, and not before.
AGAIN = 60.0


class Remarks:
    """
    Remarks that hold at present, by a name of their own.

    Parameters
    ----------
    logger
        Of the node.
    now
        The time [s].

    """

    def __init__(self, logger: RcutilsLogger, now: Callable[[], float] = time.monotonic) -> None:
        self._logger = logger
        self._now = now
        self._held: dict[str, tuple[bytes, str]] = {}
        self._until: dict[str, float] = {}  # what was logged, and is not before then

    def put(self, name: str, text: str, level: bytes = WARN) -> None:
        """
        Let a remark hold, or none of this name where ``text`` is empty; log what is new.

        What is only news, of level OK, is logged once.
        """
        if text and name not in self._held and self.due(name, inf if level == OK else AGAIN):
            self.log(text, level)
        self.hold(name, text, level)

    def due(self, name: str, pause: float = AGAIN) -> bool:
        """Tell whether to log what has this name now; if so, not again for ``pause`` [s]."""
        now = self._now()
        self._until = {each: until for each, until in self._until.items() if now < until}
        if name in self._until:
            return False
        self._until[name] = now + pause
        return True

    def hold(self, name: str, text: str, level: bytes) -> None:
        """Let a remark hold that was logged elsewhere; none where ``text`` is empty."""
        if text:
            self._held[name] = level, text
        else:
            self._held.pop(name, None)

    def log(self, text: str, level: bytes) -> None:
        """Write a line to the log."""
        # one call for each severity, as rclpy allows a line of the source one severity only
        if level == ERROR:
            self._logger.error(text)
        elif level == WARN:
            self._logger.warning(text)
        else:
            self._logger.info(text)

    def added_to(self, level: bytes, message: str) -> tuple[bytes, str]:
        """Return a level and a message with those of the remarks that are more than news."""
        for each, text in self._held.values():
            if each != OK:
                level, message = max(level, each), f'{message}; {text}'
        return level, message
