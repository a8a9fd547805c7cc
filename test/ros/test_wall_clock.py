"""A wall clock that is set while a node runs is told once, with how far and which way."""

from __future__ import annotations

from nadrc_ros.ros.diagnostics import Remarks, WARN
from nadrc_ros.ros.wall_clock import WallClock
import pytest


class Log(Remarks):
    """Remarks whose log is a list."""

    def __init__(self, now: list[float]) -> None:
        super().__init__(None, lambda: now[0])
        self.lines: list[str] = []

    def log(self, text: str, level: bytes) -> None:
        assert level == WARN
        self.lines.append(text)


@pytest.mark.parametrize(
    ('step', 'told'),
    [
        (-3.25, ['the wall clock was set back by 3.25 s: stamps jump, and waits in nodes of']),
        (3600.0, ['the wall clock was set forward by 3.6e+03 s: stamps jump']),
        (0.2, []),
    ],
)
def test_a_step_is_told(step: float, told: list[str]) -> None:
    now = [100.0]
    log, offset = Log(now), [1e9]
    clock = WallClock(log, lambda: now[0] + offset[0], lambda: now[0])
    for second in range(20):
        now[0] += 1.0
        offset[0] += 5e-4 + step * (second == 10)  # slewed all the time
        clock.look()
    assert len(log.lines) == len(told)
    assert all(line.startswith(words) for line, words in zip(log.lines, told))


def test_a_look_that_was_held_up_says_nothing() -> None:
    now = [100.0]
    log = Log(now)

    def slow() -> float:
        now[0] += 1.0
        return now[0]

    clock = WallClock(log, lambda: now[0] * 2.0, slow)
    for _ in range(10):
        clock.look()
    assert not log.lines
