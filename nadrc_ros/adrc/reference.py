"""
Derivatives of a reference that comes alone, from its samples.

They are estimated where the samples can be nothing but motion, and 0 where they can be something
else: steps, setpoints in a sequence, noise.

*Estimated*: seven filters of one kind, each with twice the memory of the one before, predict the
reference as a parabola. The slowest is followed that the faster ones do not contradict beyond
their noise: so a clean reference gets exact derivatives, a quantized one those its grain allows.

*Motion*: what one sample alone says is a step. A sample that goes on in the direction of the last
one, to where a parabola (out of a rest: one that began in it) or the estimate said it would, is
evidence of motion: the more, the smaller its distance from there is in its change, log(change /
distance). What sequences of steps
show of it by chance is not enough. A sample that is elsewhere takes the evidence away.

*Noise*: the distances from the parabola of a smooth motion keep their sign, those of noise
alternate. Noise below the grain, the step of which all changes are multiples, or from a
publisher whose timer jitters, is allowed. With more of it there are no derivatives: they would
take more of it to the command than the reference itself does.

Source: the steady-state alpha-beta-gamma filter with three equal poles (D. Simon, Optimal state
estimation, 2006, section 7.3); the choice among the memories as in A. Goldenshluger and
A. Nemirovski, On spatially adaptive estimation of nonparametric regression, Math. Methods Stat. 6,
1997; the evidence as in A. Wald, Sequential tests of statistical hypotheses, 1945.
"""

from __future__ import annotations

from math import copysign, inf, log, sqrt

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.settings import HIGHEST, LOWEST

# Derivatives that are estimated.
ESTIMATED = 3

# Poles of the filters, by their distance from 1: the memory in samples is three over it.
_PACES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
# In units of the controller's time constant 1 / wc: samples that come faster say nothing new, and
# between ones that come slower the loop goes most of the way, so that they are steps.
_SHORTEST, _LONGEST = 0.02, 1.0
# In usual spacings of the changes: a sample without a change is late, where the publisher repeats
# itself and where not; without a sample for so long it rests.
_STOPPED, _DUE, _CEASED = 1.5, 0.9, 2.5
# In standard deviations: what is no noise of a sample, what is none of a filter of long memory and
# how much more it is for a short one, what is none of all filters, and of r''. Rounding moves a
# second difference by up to two grains, 2.8 deviations: the shortest shall not follow that.
_JUMP, _CLEAR, _HASTY, _CERTAIN, _VAGUE = 6.0, 1.0, 2.0, 5.0, 1.0
# A change that grows by less from one sample to the next is one motion; one below this share of
# what the rate says is a stop; one that is off by less than this times wc h of it goes on.
_GROWTH, _STANDS, _BENDS = 10.0, 0.1, 2.0
# Evidence needed, and more of it per 1 / (wc h); the share of a change from which a sample is
# elsewhere; grains within which it is not, and the share of the need each such one is at least.
_NEEDED, _MORE, _ELSEWHERE, _GRAINS, _EACH = 2.2, 0.1, 0.6, 3.0, 0.34
# Of the grain: what is exact, and the deviation of its noise, 1 / sqrt(12); with slow samples
# (wc h) only as far as they are seen to be off a parabola.
_EXACT, _DEVIATION, _ALWAYS, _SEEN = 0.25, 0.3, 0.01, 0.08
# The noise is the mean over so many samples; to forget it takes more. Of white noise the least of
# three products in a row is this share of the variance; what is off a parabola counts up to so
# many deviations.
_LEARNT, _FORGOTTEN, _LEAST, _MOST = 10.0, 60.0, 0.24, 3.0
# The deviation of noise that is allowed: in grains, and the share of a change.
_QUANTISED, _SMOOTH = 1.0, 4e-4
# Changes that tell a grain; samples of which the mean of the jitter and the like is taken.
_BLOCK, _MEAN = 16.0, 16.0
# A jump of r'' is fed forward over so many time constants, at least over a sample.
_LEAD = 0.25
# Of a double; the share of a change below which there is no noise and no grain; and the slack of a
# sum of periods.
_RESOLUTION, _FAINT, _SLACK = 1e-12, 1e-6, 1e-6

# What is remembered, by place: times since the sample last used, since the last sample, and since
# the last change; their usual spacing, -1 at rest and 0 after the first change, and for how long
# it rested before; what the last one was off, what it spanned, and how much of it was a step.
_SINCE, _SILENT, _STILL, _SPACING, _RESTED, _EXCESS, _SPAN, _STEP = range(8)
# r, r', r'' as followed inside; the sample last used; ages and values of those before; how many.
_PLACE, _RATE, _ACCELERATION, _LAST, _AGES, _VALUES, _KNOWN = 8, 9, 10, 11, 12, 15, 18
# What is told, from r' on; the share of the evidence needed; what of r'' was fed forward by r'''.
_TOLD, _TRUST, _TRAIL = 18, 22, 23
# What the last sample was off the parabola, and the last two products of such; the share of those
# that are off; the square of the relative jitter; the largest change of late.
_OFF, _TURNED, _ROUGH, _JITTER, _SCALE = 24, 25, 27, 28, 29
# What a rest does not forget: the variance of the noise, the mean square of what is off; the grain
# of the last block of changes and of this one, and its changes so far.
_NOISE, _SQUARE, _GRAIN, _FINE, _CHANGES = 30, 31, 32, 33, 34
_FILTERS = 35
_MEMORY = _FILTERS + 3 * len(_PACES)


def blank_memory() -> list[float]:
    """Return the memory of a reference that never came."""
    return [0.0] * _MEMORY


def estimated(memory: Vector, order: int) -> float:
    """Return the derivative of that order, up to 3, that the samples so far show."""
    return memory[_TOLD + order]


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
    if memory[_KNOWN] > 0.0 and (memory[_SINCE] < shortest or memory[_SINCE] <= 0.0):
        return False
    if memory[_KNOWN] == 0.0 or memory[_SINCE] > longest or not lapse < inf:
        _rest(memory, r)
        return True
    period, turns = design.measurement_period, 0.0
    if period > 0.0:
        _turn_back(memory, whole(memory[_LAST], period))
        turns = whole(r - memory[_LAST], period)
        r -= turns
    fresh = lapse >= memory[_SINCE]
    if r == memory[_LAST]:
        if memory[_SPACING] < 0.0:
            memory[_SINCE] = 0.0
            return False
        if memory[_STILL] > longest:
            _rest(memory, r)
            return True
        late = _DUE if fresh else _STOPPED
        if not moving or memory[_SINCE] < late * memory[_SPACING] * (1.0 - _SLACK):
            return False
    _use(design, memory, r, turns == 0.0, fresh)
    return True


def _rest(memory: Vector, r: float) -> None:
    for i in range(_NOISE):
        memory[i] = 0.0
    memory[_SPACING] = -1.0
    memory[_PLACE] = memory[_LAST] = memory[_VALUES] = r
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


def _use(design: Design, memory: Vector, r: float, divides: bool, fresh: bool) -> None:
    """Weigh a sample, advance the filters by it, and choose among them."""
    dt, last, spacing = memory[_SINCE], memory[_LAST], memory[_SPACING]
    memory[_SINCE] = 0.0
    memory[_LAST] = r
    change = abs(r - last)
    prior = memory[_VALUES] - memory[_VALUES + 1] if memory[_KNOWN] > 1.0 else 0.0
    if r != last:
        if spacing == 0.0 and memory[_KNOWN] == 2.0:  # it stood there one spacing before, too
            memory[_AGES + 1] = max(memory[_AGES + 1], min(dt, memory[_RESTED]))
        if spacing < 0.0:
            memory[_SPACING] = 0.0
            memory[_RESTED] = memory[_STILL]
        elif dt > spacing:
            memory[_SPACING] = dt
        else:
            memory[_SPACING] += 0.3 * (dt - spacing)
        memory[_STILL] = 0.0
    if spacing > 0.0:
        lag = (dt / spacing) % 1.0
        lag = min(lag, 1.0 - lag)
        memory[_JITTER] += (lag * lag - memory[_JITTER]) / _MEAN
    if divides and change > 0.0:
        _divide(memory, change, _RESOLUTION * max(abs(r), change))
    rate, acceleration, before = memory[_RATE], memory[_ACCELERATION], memory[_EXCESS]
    excess = r - memory[_PLACE] - dt * (rate + 0.5 * acceleration * dt)
    wc, share = design.controller_bandwidth, 0.5 * (design.order - 1)
    pace = wc * max(dt, memory[_SPACING])
    memory[_SCALE] = max(change, abs(prior), memory[_SCALE] * (1.0 - 0.25 / _MEAN))
    quiet = max(sqrt(memory[_NOISE]), _FAINT * memory[_SCALE])
    grain, second = _grain(memory), memory[_KNOWN] == 2.0
    begun = _begun(memory, r, dt)
    off = _learn(memory, r, dt, grain)
    most = _MOST * quiet + sqrt(memory[_JITTER]) * memory[_SCALE]
    quantised = min(_DEVIATION, (_ALWAYS + _SEEN * memory[_ROUGH]) / pace)
    noise = max(quiet, min(sqrt(memory[_SQUARE]), most), grain * quantised)
    miss = min(abs(excess), off, begun)
    if memory[_STEP] * excess < 0.0:  # it may be back from there
        miss = min(miss, abs(excess + memory[_STEP]))
    elsewhere = _believe(memory, r - last, prior, miss, noise, pace)

    # What of the sample is motion, and what a step.
    rate += acceleration * dt
    allowed = _JUMP * quiet
    sure = abs(excess) <= allowed
    if before * excess > 0.0 and abs(before) > allowed:
        sure = sure or abs(excess) <= _GROWTH * abs(before)
        allowed = max(allowed, _GROWTH * abs(before) * dt / memory[_SPAN])
    if change <= _STANDS * abs(rate) * dt:
        allowed = max(allowed, abs(rate) * dt)
    if spacing < 0.0:
        sure, allowed = False, 0.0
    if memory[_TRUST] >= 1.0 and not elsewhere:
        allowed = max(allowed, min(_ELSEWHERE, _BENDS * pace) * max(change, abs(prior)))
        if miss <= allowed:
            sure, allowed = True, inf
    step = 0.0
    if abs(excess) > allowed:
        step = excess - copysign(allowed, excess)
    sure = sure and (memory[_STEP] == 0.0 or miss == begun)
    jumps = second and fresh and not sure and step == 0.0
    shorter = min(dt, memory[_SPAN]) if memory[_SPAN] > 0.0 else dt
    memory[_EXCESS], memory[_SPAN], memory[_STEP] = excess, dt, step

    # Each filter counts by what it adds to the command: wc r' + (n - 1) / 2 r'', over n wc^(n-2).
    h = max(dt, 0.5 * memory[_SPACING])
    low, high = -inf, inf
    chosen, agreed, rests, vague = _FILTERS, True, True, 0.0
    for j in range(len(_PACES)):
        p = _PACES[j]
        z = 1.0 - p
        i = _FILTERS + 3 * j
        ahead = memory[i] + step + dt * (memory[i + 1] + 0.5 * memory[i + 2] * dt)
        memory[i + 1] += memory[i + 2] * dt
        miss = r - ahead
        if jumps or (j == 0 and not sure):  # a jump of the rate is no acceleration
            memory[i] = r
            memory[i + 1] += miss / h
        else:
            memory[i] = ahead + (1.0 - z * z * z) * miss
            memory[i + 1] += 1.5 * p * p * (1.0 + z) * miss / h
            memory[i + 2] += p * p * p * miss / (h * h)
        effect = wc * memory[i + 1] + share * memory[i + 2]
        # The variances of r' h and r'' h^2, and their covariance, under noise of variance 1.
        x = wc * shorter
        spread = x * x * (6.5 + z * (25.0 + 24.5 * z))
        spread += share * p * (x * (12.0 + 24.0 * z) + 6.0 * share * p)
        spread *= p * p * p / ((1.0 + z) * (1.0 + z) * (1.0 + z))
        spread = noise * sqrt(spread) / ((1.0 + z) * shorter * shorter)
        rests = rests and abs(effect) <= _CERTAIN * spread
        agreed = agreed and low <= effect <= high
        if agreed:
            chosen = i
            vague = p / (1.0 + z)
            clear = (_CLEAR + _HASTY * p) * spread
            low = max(low, effect - clear)
            high = min(high, effect + clear)
    memory[_PLACE] = r
    memory[_RATE] = memory[_ACCELERATION] = 0.0
    if not rests:
        memory[_PLACE] = memory[chosen]
        memory[_RATE] = min(max(memory[chosen + 1], LOWEST), HIGHEST)
        if design.order > 1:
            memory[_ACCELERATION] = min(max(memory[chosen + 2], LOWEST), HIGHEST)
    vague = _VAGUE * noise * vague * vague * sqrt(6.0 * vague) / (shorter * shorter)
    _tell(memory, dt, max(dt, _LEAD / wc), vague)


def _tell(memory: Vector, dt: float, lead: float, vague: float) -> None:
    """Tell what is followed as far as it is motion and no noise; r'' is so ``vague``."""
    grain, scale, noise = _grain(memory), memory[_SCALE], memory[_NOISE]
    allowed = _QUANTISED * _QUANTISED * grain * grain
    allowed += (_SMOOTH * _SMOOTH + memory[_JITTER]) * scale * scale
    share = 1.0 if memory[_TRUST] >= 1.0 else 0.0
    if noise >= 2.0 * allowed:
        share = 0.0
    elif noise > allowed:
        share *= 2.0 - noise / allowed
    # It stands until the next sample: the rate is the one halfway.
    acceleration = memory[_ACCELERATION]
    rate = memory[_RATE] + 0.5 * memory[_SPACING] * acceleration
    memory[_TOLD + 1] = share * min(max(rate, LOWEST), HIGHEST)
    memory[_TOLD + 2] = 0.0
    if abs(acceleration) > vague:
        vague /= acceleration
        memory[_TOLD + 2] = share * (1.0 - vague * vague) * acceleration
    # A jump of the second is spread by the third, whose integral comes to it.
    left = memory[_TOLD + 2] - memory[_TRAIL]
    memory[_TOLD + 3] = min(max(left / lead, LOWEST), HIGHEST)
    memory[_TRAIL] += left * dt / lead


def _believe(
    memory: Vector, change: float, prior: float, miss: float, noise: float, pace: float
) -> bool:
    """
    Count a sample for or against motion; tell whether it is elsewhere.

    ``miss`` is how far it is from where it was expected, ``prior`` the change before, and
    ``pace`` wc times the spacing: the closer samples come, the more of them there are to ask.
    """
    grain, same = _grain(memory), change * prior > 0.0
    size = max(abs(change), abs(prior))
    near = miss <= _GRAINS * grain
    elsewhere = miss > _ELSEWHERE * size and not (same and near)
    if elsewhere:
        memory[_TRUST] = max(0.0, memory[_TRUST] - 1.0)
    elif same:
        floored = miss + max(_EXACT * grain, noise, 1e-300)
        gained = log(abs(change) / floored) / (_NEEDED + _MORE / pace)
        memory[_TRUST] = min(2.0, memory[_TRUST] + max(gained, _EACH if near else 0.0))
    return elsewhere


def _grain(memory: Vector) -> float:
    grain = memory[_GRAIN] if memory[_GRAIN] > 0.0 else memory[_FINE]
    return grain if grain > _FAINT * memory[_SCALE] else 0.0


def _divide(memory: Vector, change: float, least: float) -> None:
    """Take a change into the grain, the greatest common divisor of a block of them (Euclid)."""
    a, b = change, memory[_FINE]
    if not 0.0 < b <= least:
        while b > least:
            c = a % b
            a, b = b, min(c, b - c)
        memory[_FINE] = a
    memory[_CHANGES] += 1.0
    if memory[_CHANGES] >= _BLOCK:
        memory[_GRAIN] = memory[_FINE]
        memory[_FINE] = memory[_CHANGES] = 0.0


def _begun(memory: Vector, r: float, dt: float) -> float:
    """
    Return how far the third change after a rest is from a constant acceleration out of it.

    Its square root grows evenly from whenever it began; a later change tells nothing new.
    """
    if memory[_KNOWN] != 3.0:
        return inf
    rest = memory[_VALUES + 2]
    first, second = memory[_VALUES + 1] - rest, memory[_VALUES] - rest
    if first * second <= 0.0 or abs(second) < 4.0 * abs(first):
        return inf
    first, root = sqrt(abs(first)), sqrt(abs(second))
    root += (root - first) * dt / (memory[_AGES + 1] - memory[_AGES])
    return abs(r - rest - copysign(root * root, second))


def _learn(memory: Vector, r: float, dt: float, grain: float) -> float:
    """Return how far ``r`` is from a parabola through the last three, and learn the noise."""
    for i in range(3):
        memory[_AGES + i] += dt
    distance = inf
    if memory[_KNOWN] >= 3.0:
        a, b, c = memory[_AGES], memory[_AGES + 1], memory[_AGES + 2]
        wa = b * c / ((b - a) * (c - a))
        wb = a * c / ((a - b) * (c - b))
        wc = a * b / ((a - c) * (b - c))
        off = r - wa * memory[_VALUES] - wb * memory[_VALUES + 1] - wc * memory[_VALUES + 2]
        distance = abs(off)
        rough = 1.0 if distance > 0.5 * grain else 0.0
        memory[_ROUGH] += (rough - memory[_ROUGH]) / _MEAN
        off /= sqrt(1.0 + wa * wa + wb * wb + wc * wc)
        memory[_SQUARE] += (off * off - memory[_SQUARE]) / _LEARNT
        turned = -off * memory[_OFF]
        square = max(0.0, min(turned, memory[_TURNED], memory[_TURNED + 1])) / _LEAST
        memory[_OFF] = off
        memory[_TURNED + 1] = memory[_TURNED]
        memory[_TURNED] = turned
        noise = memory[_NOISE]
        memory[_NOISE] += (square - noise) / (_FORGOTTEN if square < noise else _LEARNT)
    memory[_KNOWN] = min(memory[_KNOWN] + 1.0, 4.0)
    for i in (2, 1):
        memory[_AGES + i] = memory[_AGES + i - 1]
        memory[_VALUES + i] = memory[_VALUES + i - 1]
    memory[_AGES] = 0.0
    memory[_VALUES] = r
    return distance
