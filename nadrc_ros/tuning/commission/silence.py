"""Whether an actuator stops by itself when nobody commands: a pulse, and then nothing is sent."""

from __future__ import annotations

from math import inf, nan

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.tuning.commission.fit import arriving
from nadrc_ros.tuning.commission.look import Look
from nadrc_ros.tuning.commission.machine import Samples
from nadrc_ros.tuning.commission.model import Model
from nadrc_ros.tuning.commission.segments import taken
import numpy as np

# Amplitudes that are tried, as shares of the largest, and what they may take of the bounds.
_SIZES = tuple(0.9 * 0.85**k for k in range(40))
_TRAVEL, _SPEED = 0.35, 0.45
# The command acts for so long [periods and times the dead time], then as much as that is watched
# after the time that the actuator should take, and that part of it.
_DRIVEN, _LATE, _MORE = 20, 3.0, 0.5
# By so many deviations of the noise a machine has to differ from one that goes on (rms).
_CLEAR = 4.0
# What is later than that part of the time that its owner said is too late.
_LATER = 1.2
# One of the two has to leave so much less unexplained; so many times are tried.
_CERTAIN, _TIMES = 2.0, 60


@attrs.frozen(kw_only=True, eq=False)
class Silence:
    """
    What came of it: the ``timeout`` [s] after the last command, inf of an actuator that goes on.

    It is nan where that cannot be told; ``given`` is what the owner said.
    """

    given: float
    timeout: float
    samples: tuple[Samples, ...] = ()
    reason: str = ''
    refusal: str = ''

    @property
    def stops(self) -> bool:
        """Tell whether it was seen to stop in the time that its owner said."""
        return self.timeout <= _LATER * self.given

    @property
    def lines(self) -> list[str]:
        """Say so."""
        if np.isnan(self.timeout):
            return [f'Whether the actuator stops by itself was not seen: {self.reason}.']
        if self.timeout == inf:
            return [
                f'The actuator went on {self.reason} after the last command: it does not stop.'
            ]
        late = '' if self.stops else f', later than the {self.given:g} s that you gave'
        return [f'Without commands the actuator stopped after {self.timeout:.2g} s{late}.']


def planned(
    base: ExperimentSettings, seen: Look, model: Model, timeout: float
) -> ExperimentSettings | None:
    """
    Return the largest pulse that stays inside the bounds though its command is never let go.

    None where what stops could not be told from what goes on.
    """
    h = base.period
    base = seen.homed(base, 1 if model.b0 > 0.0 else -1)
    base = attrs.evolve(base, kind='silence', delay=model.delay)
    driven = max(_DRIVEN * h, _LATE * model.delay)
    silence = (1.0 + _MORE) * timeout + driven
    room = max(base.highest - base.center, base.center - base.lowest)
    edges = np.array([0.0, driven + timeout, driven + silence])
    count = int(edges[-1] / h)
    for share in _SIZES:
        sent = share * room * edges
        goes_on = model.outputs(arriving(edges, sent, model.delay, count, h), h, 0.0, 0.0)
        sent[2] = sent[1]
        stops = model.outputs(arriving(edges, sent, model.delay, count, h), h, 0.0, 0.0)
        if np.abs(goes_on).max() > _TRAVEL * base.travel:
            continue
        if np.abs(np.diff(goes_on)).max() > _SPEED * base.speed * h:
            continue
        if np.sqrt(np.mean((goes_on - stops) ** 2)) < _CLEAR * base.noise:
            return None
        return attrs.evolve(
            base,
            amplitude=share * room,
            segment=driven,
            silence=silence,
            longest=max(base.longest, 2.0 * edges[-1]),
        )
    return None


def judge_silence(
    samples: Samples, settings: ExperimentSettings, model: Model, timeout: float
) -> Silence:
    """Return from when on the model has to be without command to move as it was seen."""
    silent = np.flatnonzero(samples.stage == 'silent')
    if samples.outcome != 'done' or silent.size < 2:
        return Silence(given=timeout, timeout=nan, samples=(samples,), reason=samples.reason)
    last = float(samples.time[silent[0] - 1])  # that a command was sent
    latest = settings.silence - settings.segment
    step = max(settings.period, latest / _TIMES)
    left = {
        after: _left(samples, settings, model, last + after)
        for after in np.arange(step, latest + 0.5 * step, step).tolist()
    }
    goes_on = _left(samples, settings, model, inf)
    best = min(left, key=lambda after: left[after])
    as_given = left[min(left, key=lambda after: abs(after - timeout))]
    reason = f'{samples.time[silent[-1]] - last:.2g} s'
    if _CERTAIN * left[best] > goes_on:
        best, reason = (
            (inf, reason) if _CERTAIN * goes_on < as_given else (nan, 'it may be either')
        )
    return Silence(given=timeout, timeout=best, samples=(samples,), reason=reason)


def _left(samples: Samples, settings: ExperimentSettings, model: Model, until: float) -> float:
    """Return the mean square that the model does not explain, with commands until a time [s]."""
    h, begin = settings.period, float(samples.time[0])
    known = np.isfinite(samples.measurement) & (samples.stage != 'brake')
    rest = samples.measurement[known & (samples.stage == 'start')]
    moved = samples.measurement[known] - np.mean(rest)
    time = np.maximum(taken(samples)[known] - begin, 0.0)
    edges = np.arange(0.0, float(samples.time[-1]) - begin + 2.0 * h, h)
    at = np.searchsorted(samples.time - begin, edges, side='right') - 1
    count = len(edges) - 1
    least = inf
    # what stops is without force, or takes the command that is zero
    for level in {0.0, -settings.center}:
        command = samples.command[at] - settings.center
        command[edges + begin > until] = level
        sent = np.append(0.0, np.cumsum(command[:-1] * h))
        found = model.outputs(arriving(edges, sent, model.delay, count, h), h, 0.0, 0.0)
        motion = np.interp(time, edges, np.append(0.0, found))
        size = float(motion @ motion)
        scale = min(max(float(motion @ moved) / size, 0.5), 2.0) if size > 0.0 else 1.0
        least = min(least, float(np.mean((moved - scale * motion) ** 2)))
    return least
