"""What a tuning is asked for: objective, budget, spread, constraints, search."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, flag, integer, number
from nadrc_ros.adrc.settings import HIGHEST, LONGEST
from nadrc_ros.tuning import LARGEST_W_H, LEAST_DELAY, LEAST_GAIN, LEAST_MODULUS

OBJECTIVES = ('itae', 'iae', 'ise', 'itse', 'rmse', 'max_error', 'peak_error')
SAMPLERS = ('auto', 'nsga2', 'cmaes', 'pso')
Range = tuple[float, float]


def _pair(value: Any) -> Any:
    """Return a range as a tuple; nonsense is left to the check."""
    return tuple(value) if isinstance(value, list) else value


def _pairs(value: Any) -> Any:
    return {k: _pair(span) for k, span in value.items()} if isinstance(value, Mapping) else value


def _check_pair(name: str, span: Any) -> None:
    numbers = span if isinstance(span, tuple) else ()
    fine = len(numbers) == 2 and all(
        isinstance(x, (int, float)) and not isinstance(x, bool) and isfinite(x) for x in numbers
    )
    if not (fine and numbers[0] < numbers[1]):
        raise SettingError(name, span, 'low:high with low below high')


def _check_pairs(_: object, attribute: Any, value: Any) -> None:
    if not isinstance(value, dict):
        raise SettingError(attribute.name, value, 'a mapping of names to [low, high]')
    for name, span in value.items():
        if not (span == () and attribute.name == 'vary'):
            _check_pair(f'{attribute.name}.{name}', span)


@attrs.frozen(kw_only=True)
class TuneSettings:
    """
    What to look for, and how.

    Attributes
    ----------
    vary
        Ranges by the names of what varies; an empty one stands for the default range. Nothing
        named: what :func:`~nadrc_ros.tuning.search.variables.default_variables` proposes.
    plant
        Ranges of plant coefficients, whose corners are simulated besides the nominal plant.
    b0_spread
        Factors on the input gain of the plant, the same.

    Raises
    ------
    SettingError
        For a value out of range.

    """

    objective: str = choice('itae', OBJECTIVES, 'figure of merit of tracking to minimize')
    noise_free: bool = flag(
        False, 'take the objective from a run without noise; the effort stays that with noise'
    )
    budget: float = number(
        0.0,
        0.0,
        HIGHEST**2 * LONGEST,
        '',
        'largest ISU; 0 = the whole front of objective against ISU',
    )
    sampler: str = choice(
        'auto', SAMPLERS, 'search; auto is nsga2 for the front and cmaes with a budget'
    )
    trials: int = integer(1280, 1, 10_000_000, 'designs to try')
    population: int = integer(40, 4, 10_000, 'designs of a generation')
    seeds: int = integer(3, 1, 10_000, 'noise sequences to average over')
    seed: int = integer(
        0,
        0,
        2**32 - 1,
        'seed of the search alone: it picks the designs to try; their noise has seeds of its own, '
        'the same for all, and not that of the scenario',
    )
    over: str = choice('worst', ('worst', 'mean'), 'value of the corners that counts')
    gain_margin: float = number(
        LEAST_GAIN,
        1.0,
        1e3,
        '',
        'stable if the plant gain is multiplied or divided by this',
    )
    modulus_margin: float = number(
        LEAST_MODULUS, 0.0, 1.0, '', 'least distance of the loop from -1'
    )
    delay_margin: float = number(
        LEAST_DELAY, 0.0, 1e6, 'periods', 'shortest delay that may make the loop unstable'
    )
    largest_wh: float = number(LARGEST_W_H, 1e-6, 10.0, '', 'largest bandwidth times period')
    peak: float = number(
        0.0, 0.0, HIGHEST, 'command unit', 'largest |command|; 0 = that of the limits alone'
    )
    vary: dict[str, Any] = attrs.field(factory=dict, converter=_pairs, validator=_check_pairs)
    plant: dict[str, Range] = attrs.field(factory=dict, converter=_pairs, validator=_check_pairs)
    b0_spread: tuple[float, ...] = attrs.field(default=(), converter=_pair)

    def __attrs_post_init__(self) -> None:
        if self.b0_spread != ():
            _check_pair('b0_spread', self.b0_spread)
            if self.b0_spread[0] <= 0.0:
                raise SettingError('b0_spread', self.b0_spread, 'low:high of positive factors')
        if not self.budget and self.method != 'nsga2':
            raise SettingError(
                'sampler', self.sampler, 'nsga2 without a budget: the others find no front'
            )

    @property
    def method(self) -> str:
        """Return the sampler, chosen if left open."""
        if self.sampler != 'auto':
            return self.sampler
        return 'cmaes' if self.budget else 'nsga2'
