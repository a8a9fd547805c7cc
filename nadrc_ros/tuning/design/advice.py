"""How many observers pay off, in one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from nadrc_ros.tuning import LEAST_MODULUS
from nadrc_ros.tuning.design.candidates import better_below, Candidate
from nadrc_ros.tuning.design.requirements import Requirements

# A level more has to leave less than this share of the error to be worth its margin.
WORTH = 0.8
WORDS = {1: 'one observer', 2: 'two nested observers', 3: 'three nested observers'}


def advised(found: Sequence[Candidate]) -> Candidate:
    """Return one observer, or more where each level leaves a fifth less and the loop is robust."""
    best = found[0]
    for other in _nested(found):
        predicted = other.prediction
        robust = predicted.margins.modulus >= LEAST_MODULUS
        if robust and predicted.error < WORTH * best.prediction.error:
            best = other
    return best


def advice(wanted: Requirements, found: Sequence[Candidate], best: Candidate) -> str:
    """Return what to take, what it brings at equal noise of the command, and what it costs."""
    one, nested = found[0], _nested(found)
    under = _disturbance(wanted)
    if not nested:
        return 'Take one observer: at its noise this rate and delay allow no nested ones.'
    if best is one:
        reasons: dict[str, list[str]] = {}
        for c in nested:
            leave = f'{WORDS[c.levels]} leave {_share(c, one)}'
            reasons.setdefault(_why_not(c), []).append(leave)
        said = [
            f'{" and ".join(leave)} of its error under {under}, {why}'
            for why, leave in reasons.items()
        ]
        return (
            f'Take one observer: at the same noise of the command {"; ".join(said)}.'
            f'{_limit(wanted, one, nested[0])}'
        )
    others = ', '.join(f'{WORDS[c.levels]} {_share(c, one)}' for c in nested if c is not best)
    return (
        f'Take {WORDS[best.levels]}: at the same noise of the command they leave '
        f'{_share(best, one)} of the error of one under {under}{others and f" ({others})"}.'
        f'{_limit(wanted, one, best)} The price: {_price(one, best)}.'
    )


def _why_not(candidate: Candidate) -> str:
    near = candidate.prediction.margins.modulus
    if near < LEAST_MODULUS:
        return f'but come too near to instability (modulus {near:.2f}, wanted {LEAST_MODULUS:g})'
    return 'which is too little for the margins lost'


def _limit(wanted: Requirements, one: Candidate, more: Candidate) -> str:
    below = better_below(wanted, one, more)
    if below == inf:
        return ''
    return f' {WORDS[more.levels].capitalize()} are better below {below:.3g} rad/s only.'


def _nested(found: Sequence[Candidate]) -> list[Candidate]:
    return [c for c in found if c.settings.structure == 'nested' and c.levels in WORDS]


def _share(more: Candidate, one: Candidate) -> str:
    return f'{100.0 * more.prediction.error / one.prediction.error:.0f} %'


def _disturbance(wanted: Requirements) -> str:
    if wanted.disturbance_frequency == 0.0:
        return 'a step of the disturbance'
    return f'disturbances up to {wanted.disturbance_frequency:g} rad/s'


def _price(one: Candidate, best: Candidate) -> str:
    before, after = one.prediction.margins, best.prediction.margins
    return (
        f'b / b0 from {after.gain_low:.2f} to {after.gain_high:.3g} instead of '
        f'{before.gain_low:.2f} to {before.gain_high:.3g}, delay margin '
        f'{1e3 * after.delay:.3g} instead of {1e3 * before.delay:.3g} ms'
    )
