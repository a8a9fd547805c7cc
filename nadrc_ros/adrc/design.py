"""The design: settings worked out into the plain numbers that the step functions read."""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from math import comb
from typing import Any

import attrs
from nadrc_ros.adrc.gains import equal_pole_matrix, inversion_matrix
from nadrc_ros.adrc.settings import ControllerSettings, GAIN_SOURCES
from nadrc_ros.adrc.structures import STRUCTURES

# Decay of the error of a known vibration over the bandwidth of level 1, by default: as fast as all
# the rest it would multiply the noise of the estimate by five, and so it is by one and a half.
RESONANCE_RATIO = 0.1

Vector = MutableSequence[float]
Matrix = MutableSequence[MutableSequence[float]]


@attrs.frozen(kw_only=True)
class Design:  # its slots are read five times as fast as the fields of a named tuple
    """
    Numbers of one controller; made by :func:`make_design`, never edited.

    With n the plant order, m the extended states, N = n + m and K the levels: ``bandwidths`` (K,)
    [rad/s], ``reach`` (K,) how many previous disturbance estimates enter each level's input,
    ``cancelled`` how many the command subtracts, ``gain_matrix`` (N, N) that of ``gains`` times
    ``observer_gain_factor``, ``feedback_gains`` and ``exponents`` (n,), ``feedback_level`` counted
    from 0. ``gain_source`` is 0 where b0 is constant, else what ``b0_table`` is over, from 1 on in
    the order of ``GAIN_SOURCES``.

    ``shaped`` says that an innovation is more than a difference: softened, or that of an angle;
    ``special`` says that a step is more than that of a chain with a constant b0, driven by the
    command of now: so that one question answers many. ``known`` says that the observers are those
    of :mod:`~nadrc_ros.adrc.internal_model`: with ``plant_poles`` (n,) and ``damping`` (n,),
    a_0..a_{n-1} of their polynomial, ``frequencies`` of level 1, whose N counts two states for
    each, ``sizes`` (K,), the states of every level, and ``decays`` (n + m + frequencies,), the
    poles relative to the bandwidth of the level.
    """

    order: int
    states: int
    levels: int
    b0: float
    bandwidths: list[float]
    reach: list[int]
    cancelled: int
    chained: bool
    nonlinear: bool
    shaped: bool
    eso_delta: float
    startup_time: float
    equal_poles: bool
    pole_ratios: list[float]
    observer_gain_factor: float
    gain_matrix: Matrix
    special: bool
    known: bool
    plant_poles: list[float]
    damping: list[float]
    frequencies: list[float]
    sizes: list[int]
    decays: list[float]
    error_based: bool
    no_reference: list[float]
    tracking_acceleration: float
    linear: bool
    controller_bandwidth: float
    feedback_gains: Vector
    exponents: list[float]
    fal_delta: float
    feedback_level: int
    b0_table: list[float]
    gain_source: int
    error_deadband: float
    command_min: float
    command_max: float
    command_rate_limit: float
    safe_command: float
    input_delay: float
    feed_forward_timeout: float
    measurement_min: float
    measurement_max: float
    measurement_period: float
    reference_min: float
    reference_max: float
    max_dt: float
    measurement_timeout: float
    reference_timeout: float
    hold_time: float
    good_samples: int
    stall_time: float
    stall_stops: bool
    numbers: tuple[float, ...] = attrs.field(init=False, eq=False, repr=False)

    @numbers.default
    def _all_numbers(self) -> tuple[float, ...]:
        """Return the fields that are one number, in their order."""
        fields = [getattr(self, field.name) for field in attrs.fields(Design) if field.init]
        return tuple(value for value in fields if not isinstance(value, list))


def make_design(settings: ControllerSettings) -> Design:
    """Work the settings out into a :class:`Design`; one of the same name is taken as it is."""
    structure = STRUCTURES[settings.structure]
    order = settings.plant_order
    levels = structure.levels(settings.levels)
    states = chain = order + structure.extended_states(settings.extended_states)
    frequencies = [w for w in settings.disturbance_frequencies if w > 0.0]
    states += 2 * len(frequencies)
    ratios = list(settings.pole_ratios[:chain])
    ratios += [ratios[-1]] * (chain - len(ratios))
    narrow = list(settings.pole_ratios[chain:][: len(frequencies)])
    narrow += [RESONANCE_RATIO] * (len(frequencies) - len(narrow))
    equal_poles = len(set(ratios)) == 1
    scale = ratios[0] if equal_poles else 1.0
    matrix = equal_pole_matrix(chain) if equal_poles else inversion_matrix(chain)
    plant_poles = list(settings.known_poles)
    known = any(plant_poles) or bool(frequencies)
    factor = settings.observer_gain_factor
    worked_out: dict[str, Any] = {
        'order': order,
        'states': states,
        'levels': levels,
        'bandwidths': [scale * w for w in bandwidths(settings, levels)],
        'reach': list(structure.reach(levels)),
        'cancelled': structure.cancelled(levels),
        'chained': structure.chained,
        'nonlinear': structure.nonlinear,
        'shaped': structure.nonlinear or settings.measurement_period > 0.0,
        'equal_poles': equal_poles,
        'pole_ratios': ratios,
        'known': known,
        'special': known
        or settings.input_delay > 0.0
        or settings.measurement_period > 0.0
        or settings.error_deadband > 0.0
        or gain_source(settings) > 0,
        'plant_poles': plant_poles,
        'damping': polynomial(plant_poles),
        'frequencies': frequencies,
        'sizes': [states, *[chain] * (levels - 1)],
        'decays': [ratio / scale for ratio in ratios + narrow],
        'gain_matrix': [[factor * value for value in row] for row in matrix],
        'no_reference': [0.0] * (order + 1),
        'linear': settings.feedback == 'linear',
        'feedback_gains': feedback_gains(settings),
        'exponents': _per_state(settings.fal_exponents, order),
        'feedback_level': _level_index(settings.feedback_level, levels),
        'b0_table': list(settings.b0_table),
        'gain_source': gain_source(settings),
        'stall_stops': settings.stall_action == 'fault',
    }
    names = {field.name for field in attrs.fields(Design) if field.init} - worked_out.keys()
    return Design(**{name: getattr(settings, name) for name in names}, **worked_out)


def gain_source(settings: ControllerSettings) -> int:
    """Return 0 without a table of b0, else the number of its variable."""
    return 0 if len(settings.b0_table) == 1 else 1 + GAIN_SOURCES.index(settings.b0_source)


def bandwidths(settings: ControllerSettings, levels: int) -> list[float]:
    """Return w_1 (inner), w_2 (outer), and w_{k+1} = ratio w_k beyond, shape (levels,) [rad/s]."""
    w = [settings.inner_bandwidth, settings.outer_bandwidth]
    while len(w) < levels:
        w.append(settings.bandwidth_ratio * w[-1])
    return w[:levels]


def feedback_gains(settings: ControllerSettings) -> list[float]:
    """Return k_1..k_n: the coefficients of (s + wc)^n, or the explicit gains of the fal law."""
    n = settings.plant_order
    linear = [comb(n, i) * settings.controller_bandwidth ** (n - i) for i in range(n)]
    if settings.feedback == 'linear':
        return linear
    explicit = _per_state(settings.fal_gains, n)
    return [k if k > 0.0 else default for k, default in zip(explicit, linear, strict=True)]


def polynomial(roots: Sequence[float]) -> list[float]:
    """Return a_0..a_{n-1} of prod_i (s - p_i) = s^n + a_{n-1} s^{n-1} + ... + a_0."""
    a = [1.0]
    for root in roots:
        a = [lower - root * own for lower, own in zip([0.0, *a], [*a, 0.0])]
    return a[:-1]


def _per_state(values: tuple[float, ...], order: int) -> list[float]:
    return list(values) if len(values) == order else [values[0]] * order


def _level_index(level: str, levels: int) -> int:
    if level == 'inner':
        return 0
    return levels - 1 if level == 'outer' else min(int(level), levels) - 1
