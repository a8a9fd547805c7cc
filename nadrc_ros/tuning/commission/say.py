"""What was found, what it allows, and the parameters that follow: or why there are none."""

from __future__ import annotations

from math import inf, pi
from typing import Any, NamedTuple

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST
from nadrc_ros.theory.margins import Margins, margins
from nadrc_ros.tuning.commission.excite import ACCEPTABLE, Excitation
from nadrc_ros.tuning.commission.machine import Array, Simulated
from nadrc_ros.tuning.commission.model import Model, ModelPlant
from nadrc_ros.tuning.design.bandwidths import patient
from nadrc_ros.tuning.design.limits import fastest, single_settings
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
from nadrc_ros.tuning.identification.advice import NOISE_SHARE, rounded
from nadrc_ros.tuning.identification.estimate import Estimate
import numpy as np

# What the design decides; all else stays as it is.
DESIGNED = (
    *('plant_order', 'b0', 'structure', 'levels', 'inner_bandwidth', 'controller_bandwidth'),
    'input_delay',
)
# So much slower than the fastest sound design is what begins.
CAREFUL = 2.0
# A model that leaves more than that many times the noise, and than that share of the motion, is
# none of the machine.
_STRANGE, _STRANGE_SHARE = 4.0, 0.1
# Where that is not stable, so much slower; and the least distance from instability.
_SLOWER, _MODULUS = (1.5, 2.5, 4.0, 8.0), 0.3
_FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0)
# Of the travel: the step that is proposed.
STEP_SHARE = 0.15
# Of the step: what a prediction may be off that is right.
_BAND_SHARE = 0.03
# And what is as good as held before it.
_SETTLED = 0.05
_DEVIATIONS = 3.0
_NOISIER = 1.2
# How often a machine with friction is simulated.
_SEEDS = 3
# Settling times that a step lasts.
_LASTING = 2.5
# A load of less than that part of the range of the command is not told.
_LOAD = 0.005


@attrs.frozen(kw_only=True, eq=False)
class Finding:
    """
    What is known and proposed; ``refusal`` says what is missing, and then nothing is proposed.

    ``others`` are models a standard deviation away from ``model``, each in a direction of its own.
    ``margins`` are those of the loop with the model for b0 times 0.5, 0.7, 1, 1.4 and 2; ``step``
    is the trial: ``predicted`` and ``band`` (N,) a value each period.
    """

    model: Model
    b0: Estimate
    delay: Estimate
    noise: float
    others: tuple[Model, ...] = ()
    refusal: str = ''
    settings: ControllerSettings | None = None
    present: ControllerSettings | None = None
    settling_time: float = 0.0
    fastest: float = 0.0
    limit: str = ''
    margins: dict[float, Margins] = attrs.field(factory=dict)
    step: float = 0.0
    predicted: Array = attrs.field(factory=lambda: np.zeros(0))
    band: Array = attrs.field(factory=lambda: np.zeros(0))

    @property
    def difference(self) -> dict[str, tuple[Any, Any]]:
        """Return the parameters that would change: present and new value."""
        if self.settings is None or self.present is None:
            return {}
        now, new = attrs.asdict(self.present), attrs.asdict(self.settings)
        return {name: (now[name], new[name]) for name in new if now[name] != new[name]}

    @property
    def lines(self) -> list[str]:
        """Say so."""
        model, b0 = self.model, self.b0
        lines = [
            f"Order {model.order}: the command sets the output's "
            f'{"rate" if model.order == 1 else "acceleration"}.',
            f'b0 = {b0.value:.4g} (95 %: {b0.low:.4g} to {b0.high:.4g}), dead time '
            f'{1e3 * model.delay:.3g} ms, noise {self.noise:.3g}.',
        ]
        if model.friction > 0.0:
            lines.append(f'Dry friction: commands below {model.friction:.3g} do not move it.')
        present = self.present or ControllerSettings()
        range_ = present.command_max - present.command_min
        if abs(model.load) > max(0.02 * model.friction, _LOAD * range_):
            lines.append(
                f'A constant load, as gravity, takes {model.load:+.3g} beside the resting command.'
            )
        if model.mode_share:
            lines.append(
                f'Resonance at {model.mode_frequency / (2.0 * pi):.3g} Hz, damping ratio about '
                f'{model.mode_damping:.1g}: the margins and the predicted step count it.'
            )
        if self.settings is None:
            return [*lines, self.refusal]
        s = self.settings
        low, high = (self.margins[f].modulus for f in (0.5, 2.0))
        lines += [
            f'Settling time {self.settling_time:.3g} s; {self.limit} allows '
            f'{self.fastest:.3g} s at best.',
            f'The loop: controller_bandwidth {s.controller_bandwidth:.4g} rad/s; its observer: '
            f'inner_bandwidth {s.inner_bandwidth:.4g} rad/s.',
            f'Distance from instability (1 = far, 0 = unstable): {self.margins[1.0].modulus:.2f}; '
            f'{low:.2f} if b0 is in truth half of that, {high:.2f} if it is twice.',
        ]
        return lines


def say(
    excitation: Excitation,
    base: ExperimentSettings,
    present: ControllerSettings,
    slower: float = CAREFUL,
    away: float = 0.0,
    jitter: float = 0.0,
) -> Finding:
    """
    Return what follows; ``slower`` times the fastest sound settling time is proposed.

    The machine is ``away`` [output unit] from where it rests, and its samples come with a
    ``jitter`` of that share of a period.
    """
    fitted, b0 = excitation.fitted, excitation.b0
    model = attrs.evolve(fitted.model, b0=b0.value)
    known = Finding(model=model, b0=b0, delay=fitted.delay, noise=base.noise, others=fitted.others)
    refusal = _refusal(excitation)
    if refusal:
        return attrs.evolve(known, refusal=refusal)
    noise, refusal = max(base.noise, fitted.residual), ''
    for each in (slower, 1.0):  # a spring may be too much for a slow one
        try:
            made = designed(model, b0, noise, base, present, each)
            return with_step(
                attrs.evolve(known, present=present, **made._asdict()), base, away, jitter
            )
        except Conflict as conflict:
            refusal = refusal or f'No controller is proposed: {conflict}'
    return attrs.evolve(known, refusal=refusal)


class Made(NamedTuple):
    """A design: its settings, settling time [s], the shortest one, what forbids it, margins."""

    settings: ControllerSettings
    settling_time: float
    fastest: float
    limit: str
    margins: dict[float, Margins]


def designed(
    model: Model,
    b0: Estimate,
    noise: float,
    base: ExperimentSettings,
    present: ControllerSettings,
    slower: float,
) -> Made:
    """
    Return the design for a model: ``slower`` times the fastest, or as slow as is stable.

    Raises
    ------
    Conflict
        When there is none.

    """
    room = min(base.highest - base.center, base.center - base.lowest)
    wanted, cause = fastest(
        Requirements(
            order=model.order,
            b0=rounded(b0.value),
            rate=rounded(1.0 / base.period),
            noise_std=rounded(noise, 3),
            command_noise=rounded(NOISE_SHARE * (base.command_max - base.command_min), 3),
            command_limit=rounded(room or base.highest - base.lowest),
            one_sided=room <= 0.0,
            delay=rounded(model.delay, 3) if model.delay > 0.1 * base.period else 0.0,
        )
    )
    best = wanted.settling_time
    for slow in (1.0, *_SLOWER):
        asked = attrs.evolve(wanted, settling_time=rounded(slow * slower * best, 3))
        chosen, _ = single_settings(asked)
        found = robust(model, chosen, base.period)
        if min(each.modulus for each in found.values()) > 0.0 and found[1.0].modulus > _MODULUS:
            break
    else:
        raise Conflict(
            f'with damping {model.damping:.3g} 1/s and stiffness {model.stiffness:.3g} 1/s^2 no '
            f'settling time from {best:.3g} s on is stable for b0 wrong by a factor of two'
        )
    settings = patient(
        attrs.evolve(
            present,
            **{name: getattr(chosen, name) for name in DESIGNED},
            pole_ratios=(1.0,),
            feedback='linear',
            feedback_level='inner',
            observer_gain_factor=1.0,
            plant_poles=(0.0,),
        ),
        base.period,
    )
    return Made(settings, asked.settling_time, best, cause, found)


def _refusal(excitation: Excitation) -> str:
    b0, fitted = excitation.b0, excitation.fitted
    if b0.low * b0.high <= 0.0:
        return 'Even the sign of b0 is not sure: allow more travel, speed or command.'
    if b0.half_width > ACCEPTABLE:
        return (
            f'b0 is known to +-{100 * b0.half_width:.0f} % only, and 25 % are needed: allow '
            'more time (--longest), travel, speed or command.'
        )
    strange = fitted.residual / excitation.noise if excitation.noise > 0.0 else 1.0
    if strange > _STRANGE and fitted.residual > _STRANGE_SHARE * fitted.moved:
        return (
            f'The machine does something else than this model: {fitted.residual:.3g} of its '
            f'motion of {fitted.moved:.3g} are not explained, {strange:.0f} times the noise. A '
            'resonance, backlash or a stop may do that.'
        )
    return ''


def robust(model: Model, settings: ControllerSettings, h: float) -> dict[float, Margins]:
    """Return the margins with the model, without friction, for b0 times several factors."""
    design = make_design(settings)
    return {
        factor: margins(
            design, attrs.evolve(model, b0=factor * model.b0).transfer, h, model.delay, 300
        )
        for factor in _FACTORS
    }


def with_step(
    finding: Finding, base: ExperimentSettings, away: float = 0.0, jitter: float = 0.0
) -> Finding:
    """Return the finding with a small step: how it should go, and how far off it may be."""
    assert finding.settings is not None
    model, wc = finding.model, finding.settings.controller_bandwidth
    room = min(base.highest - base.center, base.center - base.lowest) or base.highest - base.lowest
    # the command jumps by wc^n r / b0
    largest = 0.4 * (room - model.friction) * abs(model.b0) / wc**model.order
    size = min(STEP_SHARE * base.travel, 0.4 * base.speed / wc, max(largest, 0.0))
    size = max(size, min(20.0 * base.noise, 0.3 * base.travel))
    # away from a stop, else to where travel counts from
    down = model.high < inf or (model.low == -inf and away > 0.0)
    step = -size if down else size
    count = int(_LASTING * finding.settling_time / base.period)
    count = max(min(count, int(0.35 * base.longest / base.period)), 10)
    # friction lets it go by chance
    held = _SETTLED * size if model.friction == 0.0 else HIGHEST
    trial = attrs.evolve(
        base,
        kind='step',
        reference_step=step,
        predicted=(0.0,) * (2 * count),
        band=(held, *[HIGHEST] * (2 * count - 1)),
        travel=HIGHEST,
        speed=HIGHEST,
        longest=10.0 * count * base.period,
    )

    def response(other: Model, seed: int = 0) -> Array:
        assert finding.settings is not None
        noise = base.noise if model.friction > 0.0 else 0.0  # without, it only adds
        plant = ModelPlant(other, base.period, base.center, noise, seed, away)
        samples = Simulated(plant, 1.0 / base.period, finding.settings).run(
            trial, finding.settings
        )
        stepped = samples.excitation != 0.0
        if not stepped.any():
            raise Conflict('it would not hold the machine still')
        start = int(np.argmax(stepped))
        y = np.array(plant.outputs[start : start + 2 * count])
        shown: Array = y - y[0]
        return shown

    # under noise friction acts by chance
    seeds = range(_SEEDS if model.friction > 0.0 else 1)
    tries = np.array([response(model, seed) for seed in seeds])
    usual = np.mean(tries, axis=0)
    # half a period is what nobody knows of the time of a sample, and what it jitters
    late = attrs.evolve(model, delay=model.delay + (0.5 + 2.0 * jitter) * base.period)
    apart = np.array([response(other) for other in (late, *finding.others)]) - response(model)
    chance = np.max(np.abs(tries - usual), axis=0) ** 2
    deviation = np.sqrt(chance + np.sum(apart**2, axis=0) + (_NOISIER * base.noise) ** 2)
    band = _DEVIATIONS * deviation + _BAND_SHARE * size
    return attrs.evolve(finding, step=step, predicted=usual, band=band)
