"""What a sensor shows of an output that turns: at the end of its range it begins anew."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import number
from nadrc_ros.adrc.settings import HIGHEST, LOWEST

# A float of so many ranges hardly knows where in one it is.
_MOST_RANGES = 1e15


@attrs.frozen(kw_only=True)
class Sensor:
    """
    The range of a sensor that wraps; with both ends 0 it shows the output as it is.

    Raises
    ------
    SettingError
        For a range that is negative.

    """

    wrap_min: float = number(
        0.0,
        LOWEST,
        HIGHEST,
        'output unit',
        'where the range of a sensor begins that wraps, such as -180; 0 with wrap_max = 0: none',
        live=False,
    )
    wrap_max: float = number(
        0.0,
        LOWEST,
        HIGHEST,
        'output unit',
        'where the range of a sensor ends that wraps, such as 180: it shows wrap_min there',
        live=False,
    )

    def __attrs_post_init__(self) -> None:
        if self.wrap_min > self.wrap_max:
            raise SettingError('wrap_min', self.wrap_min, f'below wrap_max = {self.wrap_max!r}')


def refuse_one_end(given: Mapping[str, Any]) -> None:
    """
    Refuse a range of which only one end is given: -180 alone would be one of 180 up to 0.

    Raises
    ------
    SettingError
        Names both ends.

    """
    for name, other in (('wrap_min', 'wrap_max'), ('wrap_max', 'wrap_min')):
        if name in given and other not in given:
            raise SettingError(name, given[name], f'with {other} beside it')


def shown(value: float, low: float, high: float) -> float:
    """Return the equivalent of a value in [low, high), the value itself where that is empty."""
    width = high - low
    if not width > 0.0 or low <= value < high:
        return value
    ranges = (value - low) / width
    if not -_MOST_RANGES < ranges < _MOST_RANGES:
        return value
    turned = value - width * floor(ranges)
    return turned if low <= turned < high else low  # by rounding at an end
