"""
The five steps from an unknown machine to a tuned loop: look, nudge, excite, say, attempt.

>>> from nadrc_ros.tuning.commission import steps  # doctest: +SKIP
>>> base = steps.bounds(machine, max_command=2.0, travel=0.5, speed=2.0)  # doctest: +SKIP
>>> seen = steps.look(machine)  # doctest: +SKIP
>>> nudged = steps.nudge(machine, base, seen)  # doctest: +SKIP
>>> excited = steps.excite(machine, base, seen, nudged)  # doctest: +SKIP
>>> finding = steps.say(machine, base, seen, excited)  # doctest: +SKIP
>>> trial = steps.attempt(machine, base, seen, finding)  # doctest: +SKIP

Each result has ``lines``, which say what was found, and a ``refusal``, '' if the next step may
follow. Nothing but the experiments is changed on the machine.
"""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.tuning.commission.excite import Excitation, inside, NARROW, refined, sized
from nadrc_ros.tuning.commission.fit import Fitted
from nadrc_ros.tuning.commission.look import judge_look, Look
from nadrc_ros.tuning.commission.machine import Machine, Samples
from nadrc_ros.tuning.commission.nudge import judge_nudge, Nudge, SURE
from nadrc_ros.tuning.commission.say import CAREFUL, designed, Finding
from nadrc_ros.tuning.commission.say import say as judge
from nadrc_ros.tuning.commission.segments import doublets, segments
from nadrc_ros.tuning.design.requirements import Conflict
import numpy as np

# The first pulse of a staircase, as a share of the largest, and pulses in its whole time.
_FIRST, _PULSES = 1.0 / 40.0, 70.0
# The shortest pulse [periods].
_SHORTEST = 10
# Doublets last at first that many of their shortest pulses, and so many times longer each time.
_CHUNK, _GROWTH, _ROUNDS = 45.0, 2.0, 6
# A look is of so many samples at least.
_SEEN = 50
# How often a machine is nudged where a bound or an unsure sign ends it.
_NUDGES = 4
# After a bound, of the amplitude before.
_SMALLER = 0.6
# A nudge tells enough with that part of what is narrow, and a motion of so many times the noise.
_PLENTY, _CLEAR = 0.6, 20.0
# A machine that leaves its travel in that time [s] by itself is not nudged.
_UNTIL_AWAY = 4.0
# From that share of its travel on a machine has to be brought back before it goes on, which is
# looked at for so long [s].
_AWAY, _GLANCE = 0.4, 0.05
BRING_IT_BACK = 'Bring the machine back'
# A trial takes so many times as long as its step, as it waits until the machine is held.
_TRIAL = 3.5
# So much slower than the fastest is what catches a machine.
_SLOW = 2.0


@attrs.frozen(kw_only=True, eq=False)
class Trial:
    """How the new settings did: ``accepted``, or the ``refusal``; as predicted or not."""

    samples: Samples
    finding: Finding
    accepted: bool
    refusal: str = ''

    @property
    def lines(self) -> list[str]:
        """Say so."""
        if self.refusal:
            return [self.refusal]
        return [f'A step of {self.finding.step:.4g} and back went as predicted.']


def bounds(
    machine: Machine,
    *,
    max_command: float,
    travel: float,
    speed: float,
    center: float | None = None,
    longest: float = 20.0,
) -> ExperimentSettings:
    """
    Return what all experiments on a machine share: bounds, and what its controller has.

    Raises
    ------
    SettingError
        For a bound that is none.

    """
    present = machine.present
    period = 1.0 / machine.rate
    return ExperimentSettings(
        period=period,
        center=present.safe_command if center is None else center,
        max_command=max_command,
        command_min=present.command_min,
        command_max=present.command_max,
        command_rate_limit=present.command_rate_limit,
        travel=travel,
        speed=speed,
        longest=longest,
        measurement_timeout=max(present.measurement_timeout or 0.25, 5.0 * period),
        measurement_period=present.measurement_period,
    )


def look(machine: Machine, seconds: float = 2.0) -> Look:
    """Watch the machine for so long [s], and send nothing."""
    return judge_look(machine.listen(max(seconds, _SEEN / machine.rate)), machine.rate)


def nudge(
    machine: Machine, base: ExperimentSettings, seen: Look, before: Nudge | None = None
) -> Nudge:
    """
    Find out what moves it, and which way, by pulses that grow.

    ``before`` is the same step that ended as the machine was too far away: it goes on with what
    that told.
    """
    settings = staircase(base, seen)
    if seen.drifts and abs(seen.drift) * _UNTIL_AWAY > base.travel:
        return Nudge(
            samples=(seen.samples,),
            sign=0,
            breakaway={},
            fitted=None,
            refusal=(
                f'It drifts through its travel in {base.travel / abs(seen.drift):.2g} s with the '
                'resting command: hold it, or name a command that does (--center).'
            ),
        )
    nudged = before
    for _ in range(_NUDGES):
        runs: tuple[Samples, ...] = ()
        if nudged is not None:
            if said := gone(whereabouts(machine, base, seen), base):
                return attrs.evolve(nudged, refusal=said)
            runs, settings = nudged.samples, once_more(settings, nudged)
        samples = machine.run(settings)
        nudged = judge_nudge((*runs, samples), settings, seen.level)
        if samples.outcome in ('lost', 'stopped'):
            said = f'The experiment was not finished: {samples.reason}.'
            return attrs.evolve(nudged, refusal=said)
        if nudged.enough or (samples.outcome != 'bound' and not nudged.moves):
            break
    assert nudged is not None
    return nudged


def once_more(settings: ExperimentSettings, nudged: Nudge) -> ExperimentSettings:
    """Return the next staircase: less where a bound was met, from where it may begin to move."""
    samples, most = nudged.samples[-1], settings.max_command
    sent = float(np.nanmax(np.abs(samples.excitation)))
    if samples.outcome == 'bound' and sent > 0.0:
        most = _SMALLER * sent
    least = min(without for without, _ in nudged.breakaway.values())
    return attrs.evolve(settings, max_command=most, amplitude=min(max(least, 0.1 * most), most))


def staircase(base: ExperimentSettings, seen: Look) -> ExperimentSettings:
    """Return the staircase for a machine that was looked at."""
    room = max(base.highest - base.center, base.center - base.lowest)
    return attrs.evolve(
        seen.homed(base, 0),
        kind='staircase',
        amplitude=_FIRST * room,
        segment=max(base.longest / _PULSES, _SHORTEST * base.period),
    )


def excite(
    machine: Machine,
    base: ExperimentSettings,
    seen: Look,
    nudged: Nudge,
    before: Excitation | None = None,
) -> Excitation:
    """
    Move it to and fro until b0 is known to +-10 %, for at most ``base.longest`` [s] in all.

    Where the pulses of the nudge tell enough, nothing more is sent. ``before`` is the same step
    that ended as the machine was too far away: it goes on with what that told.
    """
    assert nudged.fitted is not None
    base = seen.homed(base, nudged.sign)
    state = Excitation(samples=(), fitted=nudged.fitted, noise=seen.noise)
    if before is not None:
        state = attrs.evolve(before, refusal='')
    elif (
        state.narrow
        and state.b0.half_width <= _PLENTY * NARROW
        and nudged.fitted.moved > _CLEAR * seen.noise
    ):
        return state
    for round_ in range(len(state.samples), _ROUNDS):
        model = state.fitted.model
        shrink = _SMALLER ** sum(each.outcome == 'bound' for each in state.samples)
        at = attrs.evolve(base, delay=model.delay, max_command=shrink * base.max_command)
        left = base.longest - state.seconds
        planned = sized(model, at) or simple(nudged, at)
        if left < 10.0 * planned.segment or planned.amplitude <= 0.0:
            break
        if state.b0.half_width > SURE:  # no more than was sent before
            planned = attrs.evolve(planned, amplitude=min(planned.amplitude, nudged.largest))
        catching = controller_for(seen, state.fitted, at, machine.present)
        chunk = _CHUNK * _GROWTH**round_
        planned = attrs.evolve(
            planned,
            kind='closed' if catching else 'doublet',
            longest=min(chunk * planned.segment, left),
            max_command=base.max_command,
            seed=planned.seed + round_,
        )
        away = whereabouts(machine, base, seen)
        if said := gone(away, base):
            return attrs.evolve(state, refusal=said)
        smaller = inside(planned, catching, model, away or 0.0, machine.present)
        if smaller is None:
            break
        runs = (*state.samples, machine.run(smaller, catching))
        found = [*nudged.fitted.segments]
        for samples in runs:
            found += segments(
                samples, doublets(samples), base.period, base.center, seen.noise, seen.level
            )
        state = refined(
            state.fitted,
            found,
            runs,
            base,
            smaller.segment,
            smaller.amplitude,
            nudged.latest,
            nudged.stop,
        )
        if samples.outcome in ('lost', 'stopped'):
            said = f'The experiment was not finished: {samples.reason}.'
            return attrs.evolve(state, refusal=said)
        if state.narrow:
            break
    return state


def simple(nudged: Nudge, base: ExperimentSettings) -> ExperimentSettings:
    """Return doublets of the size and the length that moved the machine in the nudge."""
    room = min(base.highest - base.center, base.center - base.lowest)
    moved = max(least for _, least in nudged.breakaway.values() if least == least)
    segment = max(nudged.latest, _SHORTEST * base.period)
    return attrs.evolve(base, kind='doublet', amplitude=min(moved, room), segment=segment)


def gone(away: float | None, base: ExperimentSettings) -> str:
    """Say that the machine is too far from where it began to go on, '' if it is not."""
    if away is None:
        return 'No measurement comes any more.'
    if abs(away) <= _AWAY * base.travel:
        return ''
    return (
        f'{BRING_IT_BACK}: it is {away:+.3g} away from where it began, of a travel of '
        f'{base.travel:g}. Nothing holds it, or it runs away by itself.'
    )


def whereabouts(machine: Machine, base: ExperimentSettings, seen: Look) -> float | None:
    """Return how far it is from where it was looked at, None if it is not measured any more."""
    measurement = machine.listen(max(_GLANCE, 5.0 * base.period)).measurement
    known = measurement[np.isfinite(measurement)]
    return float(np.median(known)) - seen.level if known.size else None


def controller_for(
    seen: Look,
    fitted: Fitted,
    base: ExperimentSettings,
    present: ControllerSettings,
) -> ControllerSettings | None:
    """Return a slow controller for a machine that nothing holds, None where friction does."""
    model = fitted.model
    # what drives it away at its bounds, if anything does
    most = (base.travel,) if model.order == 1 else (base.speed, base.travel)
    away = sum(max(-k, 0.0) * x for k, x in zip((model.damping, model.stiffness), most))
    if model.friction > 0.0:
        held = abs(model.b0) * model.friction > away
    else:
        held = model.order == 1 and away == 0.0 and not seen.drifts
    if held:
        return None
    try:
        return designed(model, fitted.b0, base.noise, base, present, _SLOW).settings
    except Conflict:
        return None


def say(
    machine: Machine,
    base: ExperimentSettings,
    seen: Look,
    excited: Excitation,
    slower: float = CAREFUL,
) -> Finding:
    """Return what follows from all that was seen, and from where it is; nothing is sent."""
    away = whereabouts(machine, base, seen) or 0.0
    base = attrs.evolve(base, noise=seen.noise)
    return judge(excited, base, machine.present, slower, away, seen.jitter)


def attempt(machine: Machine, base: ExperimentSettings, seen: Look, finding: Finding) -> Trial:
    """Take over with the new settings, step and step back, and compare with the prediction."""
    assert finding.settings is not None
    if said := gone(whereabouts(machine, base, seen), base):
        nothing = machine.listen(base.period)
        return Trial(samples=nothing, finding=finding, accepted=False, refusal=said)
    count = len(finding.predicted)
    settings = attrs.evolve(
        seen.homed(base, 1 if finding.b0.value > 0.0 else -1),
        kind='step',
        delay=finding.model.delay,
        amplitude=0.5 * base.max_command,
        reference_step=finding.step,
        predicted=tuple(finding.predicted),
        band=tuple(finding.band),
        longest=max(base.longest, _TRIAL * count * base.period),
    )
    samples = machine.run(settings, finding.settings)
    if samples.outcome == 'done':
        return Trial(samples=samples, finding=finding, accepted=True)
    said = {
        'worse': f'The loop is not as predicted: {samples.reason}.',
        'bound': f'A bound would have been exceeded: {samples.reason}.',
    }.get(samples.outcome, f'The step was not finished: {samples.reason}.')
    return Trial(samples=samples, finding=finding, accepted=False, refusal=said)
