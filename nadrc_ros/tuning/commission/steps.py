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

from math import inf

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.tuning.commission.excite import Excitation, NARROW, refined, sized
from nadrc_ros.tuning.commission.fit import Fitted
from nadrc_ros.tuning.commission.look import judge_look, Look
from nadrc_ros.tuning.commission.machine import Machine, Samples
from nadrc_ros.tuning.commission.nudge import judge_nudge, Nudge
from nadrc_ros.tuning.commission.say import CAREFUL, designed, Finding
from nadrc_ros.tuning.commission.say import say as judge
from nadrc_ros.tuning.commission.segments import doublets, pulses, segments
from nadrc_ros.tuning.design.requirements import Conflict

# The first pulse of a staircase, as a share of the largest, and pulses in its whole time.
_FIRST, _PULSES = 1.0 / 40.0, 70.0
# The shortest pulse [periods].
_SHORTEST = 10
# Doublets last at first that many of their shortest pulses, and so many times longer each time.
_CHUNK, _GROWTH, _ROUNDS = 45.0, 2.0, 4
# A machine that leaves its travel in that time [s] by itself is not nudged.
_UNTIL_AWAY = 4.0
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
    return judge_look(machine.listen(seconds), machine.rate)


def nudge(machine: Machine, base: ExperimentSettings, seen: Look) -> Nudge:
    """Find out what moves it, and which way, by pulses that grow."""
    settings = staircase(base, seen)
    if seen.drifts and abs(seen.drift) * _UNTIL_AWAY > base.travel:
        return Nudge(
            samples=seen.samples,
            sign=0,
            breakaway={},
            fitted=None,
            refusal=(
                f'It drifts through its travel in {base.travel / abs(seen.drift):.2g} s with the '
                'resting command: hold it, or name a command that does (--center).'
            ),
        )
    return judge_nudge(machine.run(settings), settings, seen.level)


def staircase(base: ExperimentSettings, seen: Look) -> ExperimentSettings:
    """Return the staircase for a machine that was looked at."""
    room = max(base.highest - base.center, base.center - base.lowest)
    return attrs.evolve(
        base,
        kind='staircase',
        noise=seen.noise,
        amplitude=_FIRST * room,
        segment=max(base.longest / _PULSES, _SHORTEST * base.period),
    )


def excite(
    machine: Machine, base: ExperimentSettings, seen: Look, nudged: Nudge, seconds: float = inf
) -> Excitation:
    """
    Move it to and fro until b0 is known to +-10 %, for at most ``base.longest`` [s] in all.

    Where the pulses of the nudge tell enough, nothing more is sent.
    """
    assert nudged.fitted is not None
    base = attrs.evolve(base, noise=seen.noise, sign=nudged.sign, homed=True, home=seen.level)
    found = segments(
        nudged.samples, pulses(nudged.samples), base.period, base.center, seen.noise, seen.level
    )
    fitted = nudged.fitted
    runs: tuple[Samples, ...] = ()
    spent, shrink = 0.0, 1.0
    pace, size = _SHORTEST * base.period, 0.25 * base.max_command
    state: Excitation | None = None
    chunk = _CHUNK
    for _ in range(_ROUNDS):
        model = fitted.model
        at = attrs.evolve(base, delay=model.delay, max_command=base.max_command * shrink)
        planned = sized(model, attrs.evolve(at, longest=base.longest))
        catching = controller_for(nudged, seen, fitted, at, machine.present)
        left = min(base.longest, seconds) - spent
        if planned is None or left < 10.0 * planned.segment:
            break
        length = min(chunk * planned.segment, left)
        planned = attrs.evolve(planned, longest=length, max_command=base.max_command)
        samples = machine.run(
            attrs.evolve(
                planned, seed=planned.seed + len(runs), kind='closed' if catching else 'doublet'
            ),
            catching,
        )
        runs += (samples,)
        spent += float(samples.time[-1] - samples.time[0])
        new = segments(
            samples, doublets(samples), base.period, base.center, seen.noise, seen.level
        )
        found = found + new
        pace, size = planned.segment, planned.amplitude
        state = refined(fitted, found, runs, base, pace, size, spent)
        fitted = state.fitted
        if samples.outcome == 'bound':
            shrink *= 0.6
        if samples.outcome == 'lost':
            return attrs.evolve(state, refusal=f'The measurement was lost: {samples.reason}')
        if state.b0.half_width <= NARROW and samples.outcome == 'done':
            return state
        chunk *= _GROWTH
    if state is None:
        state = Excitation(
            samples=(), segments=tuple(found), fitted=fitted, noise=seen.noise, seconds=0.0
        )
    return state


def controller_for(
    nudged: Nudge,
    seen: Look,
    fitted: Fitted,
    base: ExperimentSettings,
    present: ControllerSettings,
) -> ControllerSettings | None:
    """Return a slow controller for a machine that nothing holds, None where friction does."""
    model = fitted.model
    runs_away = model.damping < 0.0 or model.stiffness < 0.0
    if model.friction > 0.0 or (model.order == 1 and not runs_away and not seen.drifts):
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
    """Return what follows from all that was seen; nothing is sent."""
    base = attrs.evolve(base, noise=seen.noise)
    return judge(excited, base, machine.present, slower)


def attempt(machine: Machine, base: ExperimentSettings, seen: Look, finding: Finding) -> Trial:
    """Take over with the new settings, step and step back, and compare with the prediction."""
    assert finding.settings is not None
    count = len(finding.predicted)
    settings = attrs.evolve(
        base,
        kind='step',
        noise=seen.noise,
        homed=True,
        home=seen.level,
        sign=1 if finding.b0.value > 0.0 else -1,
        delay=finding.model.delay,
        amplitude=0.5 * base.max_command,
        reference_step=finding.step,
        predicted=tuple(finding.predicted),
        band=tuple(finding.band),
        longest=max(base.longest, 3.0 * count * base.period),
    )
    samples = machine.run(settings, finding.settings)
    if samples.outcome == 'done':
        return Trial(samples=samples, finding=finding, accepted=True)
    said = {
        'worse': f'The loop is not as predicted: {samples.reason}.',
        'bound': f'A bound would have been exceeded: {samples.reason}.',
    }.get(samples.outcome, f'The step was not finished: {samples.reason}.')
    return Trial(samples=samples, finding=finding, accepted=False, refusal=said)
