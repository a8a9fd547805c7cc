"""
Derivatives of a reference that comes alone, from its samples.

Seven filters of one kind, each with twice the memory of the one before, predict the reference as
a parabola. Samples may come slower than the ticks, or unchanged at each tick, late, quantised and
with noise. Of each filter it is known how much of white noise its derivatives let through to the
command. The slowest is followed that the faster ones do not contradict beyond their noise, and
none where no motion is beyond it: so a clean reference gets exact derivatives after three samples,
a noisy one those that its noise allows, and one that rests gets none.

What one sample alone says is a step, and a step has no derivative: the filters take it along.
Motion is what the next sample confirms; to slow down needs no confirmation. So a second step soon
after the first is taken for motion, too: this is for trajectories, not for setpoints that come in
a sequence.

Source: the steady-state alpha-beta-gamma filter with three equal poles (D. Simon, Optimal state
estimation, 2006, section 7.3); the choice among the memories as in A. Goldenshluger and
A. Nemirovski, On spatially adaptive estimation of nonparametric regression, Math. Methods Stat. 6,
1997.
"""

from __future__ import annotations

from math import copysign, inf, sqrt

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.settings import HIGHEST, LOWEST

# Poles of the filters, by their distance from 1: the memory in samples is three over it.
_PACES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
# In units of the controller's time constant 1 / wc: samples that come faster say nothing new, and
# between ones that come slower the loop settles, so that they are steps.
_SHORTEST, _LONGEST = 0.02, 2.0
# In usual spacings of the changes: without a change for so long it rests, nor without a sample.
_STOPPED, _CEASED = 1.5, 2.5
# In standard deviations: what is no noise of a sample, and what is none of a filter.
_JUMP, _CLEAR = 6.0, 5.0
# A change that grows by less from one sample to the next is one motion; one below this share of
# what the rate says is a stop.
_GROWTH, _STANDS = 10.0, 0.1
# The noise is the mean over so many samples, the first of which only teach it; to forget noise it
# takes more: an estimate that is too low by chance makes motion of noise. It begins as this share
# of a change, and one sample counts for no more than so many variances.
_LEARNT, _FORGOTTEN, _LEAST, _MOST, _RETURNS = 10.0, 20.0, 2e-3, 16.0, 0.3
# Of a double, and the slack of a sum of periods.
_RESOLUTION, _SLACK = 1e-10, 1e-6

# What is remembered, by place: times since the sample last used, since the last sample, and since
# the last change; their usual spacing, -1 at rest and 0 after the first change; the samples so
# far; the largest change of the first ones; the variance of their noise; what the last one was
# off, what it spanned, and how much of it was a step.
_SINCE, _SILENT, _STILL, _SPACING, _COUNT, _LARGEST, _NOISE, _EXCESS, _SPAN, _STEP = range(10)
# r, r', r'' as followed; the sample last used; ages and values of those before; their count.
_PLACE, _RATE, _ACCELERATION, _LAST, _AGES, _VALUES, _KNOWN = 10, 11, 12, 13, 14, 17, 20
_FILTERS = 21
_MEMORY = _FILTERS + 3 * len(_PACES)


def blank_memory() -> list[float]:
    """Return the memory of a reference that never came."""
    return [0.0] * _MEMORY


def estimated(memory: Vector, order: int) -> float:
    """Return the derivative of that order, 1 or 2, that the samples so far show."""
    return memory[_PLACE + order]


def follow(
    design: Design, memory: Vector, r: float, came: bool, elapsed: float, span: float
) -> bool:
    """
    Take a sample ``r`` of the reference, if one ``came``; tell whether derivatives may be others.

    ``elapsed`` is the time since the last call [s], ``span`` that since the sample before it was
    sent, if it is above 0, and ``memory`` what :func:`blank_memory` returns.
    """
    memory[_SILENT] += elapsed
    moving = memory[_SPACING] > 0.0
    if not came:
        silent = memory[_SILENT] > _CEASED * memory[_SPACING] * (1.0 + _SLACK)
        if moving and silent:
            _rest(memory, memory[_LAST])
        return moving and silent
    lapse = span if span > 0.0 else memory[_SILENT]
    memory[_SILENT] = 0.0
    memory[_SINCE] += lapse
    memory[_STILL] += lapse
    shortest = _SHORTEST / design.controller_bandwidth * (1.0 - _SLACK)
    longest = min(_LONGEST / design.controller_bandwidth, design.max_dt)
    if memory[_COUNT] > 0.0 and (memory[_SINCE] < shortest or memory[_SINCE] <= 0.0):
        return False
    memory[_COUNT] += 1.0
    if memory[_COUNT] == 1.0 or memory[_SINCE] > longest or not lapse < inf:
        _rest(memory, r)
        return True
    period = design.measurement_period
    if period > 0.0:
        _turn_back(memory, whole(memory[_LAST], period))
        r -= whole(r - memory[_LAST], period)
    if r == memory[_LAST]:
        if memory[_SPACING] < 0.0:
            memory[_SINCE] = 0.0
            return False
        if memory[_STILL] > longest:
            _rest(memory, r)
            return True
        if not moving or memory[_SINCE] < _STOPPED * memory[_SPACING] * (1.0 - _SLACK):
            return False
    _use(design, memory, r)
    return True


def _rest(memory: Vector, r: float) -> None:
    memory[_SINCE] = memory[_STILL] = memory[_EXCESS] = memory[_SPAN] = memory[_STEP] = 0.0
    memory[_RATE] = memory[_ACCELERATION] = 0.0
    memory[_SPACING] = -1.0
    memory[_PLACE] = memory[_LAST] = memory[_VALUES] = r
    memory[_AGES] = 0.0
    memory[_KNOWN] = 1.0
    for i in range(_FILTERS, _MEMORY):
        memory[i] = r if (i - _FILTERS) % 3 == 0 else 0.0


def _turn_back(memory: Vector, turns: float) -> None:
    """Take whole periods off all values, so that they stay precise however long it turns."""
    if turns != 0.0:
        memory[_PLACE] -= turns
        memory[_LAST] -= turns
        for i in range(3):
            memory[_VALUES + i] -= turns
        for j in range(len(_PACES)):
            memory[_FILTERS + 3 * j] -= turns


def _use(design: Design, memory: Vector, r: float) -> None:
    """Advance the filters by a sample, and choose among them."""
    dt, last, spacing = memory[_SINCE], memory[_LAST], memory[_SPACING]
    memory[_SINCE] = 0.0
    memory[_LAST] = r
    change = abs(r - last)
    if r != last:
        memory[_STILL] = 0.0
        if spacing < 0.0:
            memory[_SPACING] = 0.0
        elif dt > spacing:
            memory[_SPACING] = dt
        else:
            memory[_SPACING] += 0.3 * (dt - spacing)
    rate, acceleration, before = memory[_RATE], memory[_ACCELERATION], memory[_EXCESS]
    excess = r - memory[_PLACE] - dt * (rate + 0.5 * acceleration * dt)
    noise = sqrt(memory[_NOISE])
    returns = before * excess < 0.0 and abs(excess) > _RETURNS * abs(before)
    _learn(memory, r, dt, change, returns and memory[_STEP] != 0.0)  # then it was no step

    # What of the sample is motion, and what a step.
    rate += acceleration * dt
    allowed = _JUMP * noise
    sure = abs(excess) <= allowed
    if before * excess > 0.0 and abs(before) > allowed:
        sure = sure or abs(excess) <= _GROWTH * abs(before)
        allowed = max(allowed, _GROWTH * abs(before) * dt / memory[_SPAN])
    if change <= _STANDS * abs(rate) * dt:
        allowed = max(allowed, abs(rate) * dt)
    step = 0.0
    if abs(excess) > allowed:
        step = excess - copysign(allowed, excess)
    sure = sure and memory[_STEP] == 0.0
    shorter = min(dt, memory[_SPAN]) if memory[_SPAN] > 0.0 else dt
    memory[_EXCESS], memory[_SPAN], memory[_STEP] = excess, dt, step

    # Each filter counts by what it adds to the command: wc r' + (n - 1) / 2 r'', over n wc^(n-2).
    wc, share = design.controller_bandwidth, 0.5 * (design.order - 1)
    h = max(dt, 0.5 * memory[_SPACING])
    if memory[_COUNT] < _LEARNT:
        memory[_LARGEST] = max(memory[_LARGEST], change)
        noise = max(noise, memory[_LARGEST])
    low, high = -inf, inf
    chosen, agreed, rests = 0, True, True
    for j in range(len(_PACES)):
        p = _PACES[j]
        z = 1.0 - p
        i = _FILTERS + 3 * j
        ahead = memory[i] + step + dt * (memory[i + 1] + 0.5 * memory[i + 2] * dt)
        memory[i + 1] += memory[i + 2] * dt
        off = r - ahead
        if j == 0 and not sure:  # a jump of the rate is no acceleration
            memory[i] = r
            memory[i + 1] += off / h
        else:
            memory[i] = ahead + (1.0 - z * z * z) * off
            memory[i + 1] += 1.5 * p * p * (1.0 + z) * off / h
            memory[i + 2] += p * p * p * off / (h * h)
        effect = wc * memory[i + 1] + share * memory[i + 2]
        # The variances of r' h and r'' h^2, and their covariance, under noise of variance 1.
        x = wc * shorter
        spread = x * x * (6.5 + z * (25.0 + 24.5 * z))
        spread += share * p * (x * (12.0 + 24.0 * z) + 6.0 * share * p)
        spread *= p * p * p / ((1.0 + z) * (1.0 + z) * (1.0 + z))
        spread = _CLEAR * noise * sqrt(spread) / ((1.0 + z) * shorter * shorter)
        rests = rests and abs(effect) <= spread
        agreed = agreed and low <= effect <= high
        if agreed:
            chosen = i
            low = max(low, effect - spread)
            high = min(high, effect + spread)
    if rests:
        memory[_PLACE] = r
        memory[_RATE] = memory[_ACCELERATION] = 0.0
    else:
        memory[_PLACE] = memory[chosen]
        memory[_RATE] = min(max(memory[chosen + 1], LOWEST), HIGHEST)
        memory[_ACCELERATION] = 0.0
        if design.order > 1:
            memory[_ACCELERATION] = min(max(memory[chosen + 2], LOWEST), HIGHEST)


def _learn(memory: Vector, r: float, dt: float, change: float, returns: bool) -> None:
    """Take into the variance of the noise how far ``r`` is from a parabola through the last."""
    for i in range(3):
        memory[_AGES + i] += dt
    noise = memory[_NOISE]
    if memory[_KNOWN] == 3.0:
        a, b, c = memory[_AGES], memory[_AGES + 1], memory[_AGES + 2]
        wa = b * c / ((b - a) * (c - a))
        wb = a * c / ((a - b) * (c - b))
        wc = a * b / ((a - c) * (b - c))
        off = r - wa * memory[_VALUES] - wb * memory[_VALUES + 1] - wc * memory[_VALUES + 2]
        square = off * off / (1.0 + wa * wa + wb * wb + wc * wc)
        pace = min(memory[_COUNT], _LEARNT)
        if memory[_COUNT] > _LEARNT:
            if not returns:
                square = min(square, _MOST * noise)
            if square < noise:
                pace = _FORGOTTEN
        noise += (square - noise) / pace
    else:
        memory[_KNOWN] += 1.0
    least = _RESOLUTION * abs(r)
    if noise <= least * least:
        least = max(least, _LEAST * change)
        noise = least * least
    memory[_NOISE] = noise
    for i in (2, 1):
        memory[_AGES + i] = memory[_AGES + i - 1]
        memory[_VALUES + i] = memory[_VALUES + i - 1]
    memory[_AGES] = 0.0
    memory[_VALUES] = r
