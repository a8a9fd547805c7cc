"""The pinned stretch of a run: its figures beside those of now, and the way back to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from math import nan
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.live.blocks import Array
from nadrc_ros.live.comparison import figures, same_stretch
from nadrc_ros.live.monitor import KEPT, Monitor
from nadrc_ros.live.outbox import Message
from nadrc_ros.live.undo import Values
import numpy as np

# Unless a page says otherwise, so much is pinned, and at least so much [s].
_USUAL, _LEAST = 10.0, 0.5
# An error so many times the pinned peak, or a command that stood at a limit so long [s], is bad.
_TIMES, _AT_LIMIT = 3.0, 0.5

SetAll = Callable[[Mapping[str, Any]], Awaitable[None]]


@attrs.frozen
class Stretch:
    """A part of the run, ``begin`` to ``end`` [s], with its figures and its parameters."""

    begin: float
    end: float
    figures: Values
    parameters: Values

    def told(self) -> Message:
        """Return it for a page."""
        return {'from': self.begin, 'to': self.end, 'figures': self.figures}


class Pinned:
    """
    What is pinned, if anything is, and what it is for: to compare, to swap, to go back to.

    Attributes
    ----------
    stretch
        That which is pinned.
    guarded
        Whether the loop goes back to its parameters when it gets much worse.

    """

    def __init__(self, monitor: Monitor, set_all: SetAll) -> None:
        self.stretch: Stretch | None = None
        self.guarded = False
        self._monitor = monitor
        self._set_all = set_all
        self._other: Values = {}
        # When parameters changed, and to what they were before.
        self._changes: deque[tuple[float, Values]] = deque()
        self._limited_since = nan

    # ---- requests ----

    def pin(self, begin: Any, end: Any) -> Message:
        """Pin a stretch, with the parameters that held in it."""
        ring = self._monitor.ring
        high = min(float(end), ring.last) if isinstance(end, (int, float)) else ring.last
        low = float(begin) if isinstance(begin, (int, float)) else high - _USUAL
        low = max(low, ring.first)
        changed = [t for t, _ in self._changes if low < t < high]
        if changed:
            low = changed[-1]
        rows = ring.between(low, high)
        if len(rows) < 2 or rows[-1, 0] - rows[0, 0] < _LEAST:
            raise UserError(
                f'{_LEAST:g} s of samples with the same parameters are needed to pin them'
            )
        self.stretch = Stretch(low, high, self._figures(rows, high), self._parameters(high))
        self._other = dict(self.stretch.parameters)
        more = ', from the last change of parameters on' if changed else ''
        return {'text': f'pinned: {low:.1f} to {high:.1f} s{more}', 'from': low, 'to': high}

    def unpin(self) -> Message:
        """Pin nothing."""
        self.stretch, self.guarded, self._other = None, False, {}
        return {'text': 'nothing is pinned'}

    async def swap(self) -> Message:
        """Apply the other of the two sets of parameters."""
        if self.stretch is None:
            raise UserError('pin a stretch first: swap goes to its parameters and back')
        now, values = self._now(), self._different(self._other)
        if not values:
            raise UserError('both sets of parameters are the same')
        await self._set_all(values)
        self._other |= {name: now[name] for name in values}
        return {'text': f'swapped: {", ".join(values)}', 'values': values}

    def guard(self, on: bool) -> Message:
        """Go back to the pinned parameters when the loop gets much worse, or do not."""
        if on and self.stretch is None:
            raise UserError('pin a stretch first: that is what there would be to go back to')
        self.guarded, self._limited_since = on, nan
        return self.told_guard()

    def told_guard(self) -> Message:
        """Return whether the loop is guarded, and by what."""
        peak = self.stretch.figures.get('max_error') if self.stretch else None
        text = 'not guarded'
        if self.guarded and peak is not None:
            text = (
                f'back to the pinned parameters when |e| exceeds {_TIMES * peak:.4g} or the '
                f'command stands at a limit for {_AT_LIMIT:g} s'
            )
        return {'type': 'guard', 'on': self.guarded, 'text': text}

    # ---- what happens ----

    def note_change(self, t: float, before: Values) -> None:
        """Note a change of parameters at ``t`` [s], with the values before it."""
        self._changes.append((t, before))
        while self._changes[0][0] < t - KEPT:
            self._changes.popleft()

    async def restore(self) -> None:
        """Go back to the pinned parameters, and guard nothing any more."""
        if self.stretch is not None:
            await self._set_all(self._different(self.stretch.parameters))

    def trouble(self, rows: Array) -> str:
        """Return why to go back, from new rows, '' if that is not asked for or not needed."""
        if not self.guarded or self.stretch is None:
            return ''
        why = self._trouble(rows, self.stretch)
        if why and self._different(self.stretch.parameters):
            self.guarded = False
            return why
        return ''

    def comparison(self) -> Message:
        """Return what pages are told while a stretch is pinned."""
        found: Message = {'type': 'comparison', 'comparable': False, 'error': 'of the reference'}
        if self.stretch is None:
            return found | {'why': 'nothing is pinned', 'before': None, 'after': None}
        pinned = self.stretch
        found |= {'before': pinned.told(), 'after': None}
        ring, signals = self._monitor.ring, self._monitor.signals
        after = max([pinned.end, *(t for t, _ in self._changes)])
        place = 1 + signals.index('reference')
        rows = ring.between(pinned.begin, ring.last)
        if not len(rows):
            return found | {'why': 'there are no samples yet'}
        begin, why = same_stretch(rows[:, [0, place]], pinned.begin, pinned.end, after)
        if why:
            return found | {'why': why}
        end = begin + pinned.end - pinned.begin
        part = rows[(rows[:, 0] >= begin) & (rows[:, 0] <= end)]
        told = {'from': begin, 'to': end, 'figures': self._figures(part, end)}
        return found | {'comparable': True, 'why': '', 'after': told}

    # ---- parts ----

    def _trouble(self, rows: Array, pinned: Stretch) -> str:
        signals = self._monitor.signals
        reference, measured, output, command = (
            rows[:, 1 + signals.index(name)]
            for name in ('reference', 'measurement', 'output', 'command')
        )
        error = np.abs(reference - np.where(np.isnan(output), measured, output))
        peak = pinned.figures.get('max_error')
        if peak is not None and (error > _TIMES * peak).any():
            return f'|e| = {np.nanmax(error):.4g} is over {_TIMES:g} times the pinned peak'
        now = self._now()
        low, high = now.get('command_min', -np.inf), now.get('command_max', np.inf)
        limited = (command <= low) | (command >= high)
        for t, at_limit in zip(rows[:, 0], limited):
            if not at_limit:
                self._limited_since = nan
            elif self._limited_since != self._limited_since:
                self._limited_since = float(t)
            elif t - self._limited_since >= _AT_LIMIT:
                return f'the command stood at a limit for {_AT_LIMIT:g} s'
        return ''

    def _figures(self, rows: Array, end: float) -> Values:
        monitor = self._monitor
        recorder = monitor.parameters(monitor.recorder)
        return figures(monitor.signals, rows, end, recorder, self._now())

    def _different(self, values: Values) -> Values:
        """Return which of these values do not hold now."""
        now = self._now()
        return {name: each for name, each in values.items() if name in now and now[name] != each}

    def _now(self) -> Values:
        return self._monitor.parameters(self._monitor.controller)

    def _parameters(self, t: float) -> Values:
        """Return the live parameters of the time ``t`` [s]."""
        values = {
            name: value
            for name, value in self._now().items()
            if (found := self._monitor.descriptors.get(name)) and not found.read_only
        }
        for moment, before in reversed(self._changes):
            if moment > t:
                values |= before
        return values
