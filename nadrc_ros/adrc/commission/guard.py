"""
The bounds of an experiment: where the machine is, how fast, and whether it can still be stopped.

The speed is the slope of a straight line through the last samples, as many as the noise asks for.
"""

from __future__ import annotations

from collections import deque
from math import sqrt

from nadrc_ros.adrc.angle import short
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.settings import HIGHEST, LOWEST

# Samples of the line, and what share of the speed bound a few deviations of its slope may be.
_FEWEST, _MOST, _DEVIATIONS, _SHARE = 3, 64, 5.0, 0.25
# And what share of the travel a motion of one deviation may be in a pulse: else a machine that
# runs away slowly would count as one that rests.
_CREEP = 0.02
# A sample that is so many times as far away as the speed bound explains is passed over, once.
_ODD = 5.0
# A speed below that share of its bound is none.
_STILL = 0.02
_START_SAMPLES = 5
# What is kept free of a bound, for what the line sees late.
_KEPT = 0.9
# And of travel, where nobody knows yet what brakes.
_KEPT_NUDGED = 0.5


class Guard:
    """
    What is known of the motion, and when it has to end.

    Attributes
    ----------
    start
        The output where the experiment began, of the first samples; None until then.
    away, raw
        By how much that is away from where travel counts from; the last sample relative to it.
    moved, velocity, growth
        The output relative to where its travel counts from [output unit], at the end of the line,
        its slope, and by how much that grows [output unit/s^2].
    fastest, still
        The largest speed so far; and one below which there is none [output unit/s].
    late
        How late the line sees what happens [s].
    silence
        Time since the last valid sample [s].

    """

    def __init__(self, settings: ExperimentSettings) -> None:
        self._settings = settings
        self.window = samples_for(settings)
        deviation = settings.noise * slope_noise(self.window) / settings.period
        self.late = (1.0 + 0.5 * self.window) * settings.period
        self.still = max(3.0 * deviation, min(_STILL * settings.speed, 3.0 * creep(settings)))
        self.start: float | None = None
        self.raw = self.away = 0.0
        self.moved = self.velocity = self.fastest = self.growth = self.silence = 0.0
        self._moving = 0.0
        self._samples: deque[tuple[float, float]] = deque(maxlen=self.window)
        self._speeds: deque[float] = deque(maxlen=self.window)
        self._first: list[float] = []
        self._last: float | None = None
        self._time = 0.0
        self._odd = False

    def take(self, measurement: float, dt: float, elapsed: float) -> bool:
        """Take the sample of a tick in; False if none came, or it is none."""
        self.silence += elapsed
        self._time += dt if 0.0 < dt < HIGHEST else 0.0
        if not (dt > 0.0 and LOWEST <= measurement <= HIGHEST):
            return False
        settings, value = self._settings, measurement
        if self._last is not None:
            value = self._last + short(measurement - self._last, settings.measurement_period)
            near = _ODD * settings.speed * self.silence + 8.0 * settings.noise
            if not self._odd and abs(value - self._last) > near:
                self._odd = True
                return False
        self._odd = False
        self._last, self.silence = value, 0.0
        if self.start is None:
            self._first.append(value)
            if len(self._first) >= max(_START_SAMPLES, self.window):
                self.start = sorted(self._first)[len(self._first) // 2]
        self._samples.append((self._time, value))
        before = self.velocity
        level, self.velocity = line(self._samples)
        self.fastest = max(self.fastest, abs(self.velocity))
        moves = abs(self.velocity) > self.still and self.velocity * before > 0.0
        self._moving = self._moving + dt if moves else 0.0
        self._speeds.append(self.velocity)
        self.growth = (self.velocity - self._speeds[0]) / (self.window * settings.period)
        if self.start is not None:
            self.raw = value - self.start
            self.away = self.start - settings.home if settings.homed else 0.0
            self.away = short(self.away, settings.measurement_period)
            self.moved = level - self.start + self.away
        return True

    def complaint(self, delay: float) -> str:
        """
        Say which bound cannot be kept any more unless the motion is braked now, '' if all can.

        A motion that what drives it speeds up for a time takes as long to brake, and comes to
        rest after another v time / 2. It goes on meanwhile for the dead time of the machine,
        ``delay`` [s], and for what the line sees late.
        """
        settings, velocity = self._settings, abs(self.velocity)
        late = delay + self.late
        outward = self.moved * self.velocity > 0.0
        reach = abs(self.moved)
        if outward:
            reach += velocity * (late + 0.5 * self._moving)
        kept = _KEPT_NUDGED if settings.kind == 'staircase' else _KEPT
        if reach > kept * settings.travel:
            return f'travel: {self.moved:+.4g} of {settings.travel:g}, at {self.velocity:+.3g}/s'
        gaining = self.growth * self.velocity > 0.0
        fastest = velocity + (abs(self.growth) * late if gaining else 0.0)
        if velocity > 0.5 * settings.speed and fastest > _KEPT * settings.speed:
            return f'speed: {self.velocity:+.4g} of {settings.speed:g}'
        return ''


def slope_noise(count: int) -> float:
    """Return the deviation of the slope of ``count`` samples, spaced by 1, of deviation 1."""
    return sqrt(12.0 / (count * (count * count - 1.0)))


def creep(settings: ExperimentSettings) -> float:
    """Return the speed of a motion that is slow beside the travel [output unit/s]."""
    return _CREEP * settings.travel / settings.segment


def samples_for(settings: ExperimentSettings) -> int:
    """Return how many samples tell the speed well enough for its bound, and that of travel."""
    slow = min(_SHARE * settings.speed / _DEVIATIONS, creep(settings))
    count = _FEWEST
    while count < _MOST and settings.noise * slope_noise(count) / settings.period > slow:
        count += 1
    return count


def line(samples: deque[tuple[float, float]]) -> tuple[float, float]:
    """Return the last value of the straight line through samples (time, value), and its slope."""
    count = len(samples)
    last_time, last = samples[-1]
    if count < 2:
        return last, 0.0
    time = sum(t - last_time for t, _ in samples) / count
    value = sum(y - last for _, y in samples) / count
    spread = sum((t - last_time - time) ** 2 for t, _ in samples)
    if not spread > 0.0:
        return last, 0.0
    slope = sum((t - last_time - time) * (y - last - value) for t, y in samples) / spread
    return last + value - slope * time, slope
