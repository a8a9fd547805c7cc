"""The units of the output and the command, which go with every axis and table."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import text

_LONGEST = 20
_TIMES = '·'


@attrs.frozen(kw_only=True)
class Units:
    """
    The units of a loop as they are written, '' where nobody said.

    Raises
    ------
    SettingError
        For one that does not fit an axis.

    """

    output: str = text('', 'unit of the output, the measurement and the reference', live=False)
    command: str = text('', 'unit of the command', live=False)

    def __attrs_post_init__(self) -> None:
        for name, value in attrs.asdict(self).items():
            if len(value) > _LONGEST or not value.isprintable():
                allowed = f'at most {_LONGEST} printable characters, as rad, V or m/s'
                raise SettingError(name, value, allowed)

    def of(self, column: str, order: int = 0) -> str:
        """
        Return the unit of a signal, '' if it is not known.

        That of the total disturbance is the one of y^(n) of a plant of this order, which is not
        known for order 0.
        """
        if column == 'command':
            return self.command
        if column in ('truth', 'estimate', 'miss') or column.startswith('level_'):
            return _rate_of(self.output, order) if order else ''
        return self.output

    def of_figure(self, name: str) -> str:
        """Return the unit of a figure of merit, '' if it is not known."""
        output, command = self.output, self.command
        found = {
            'itae': output and f'{output}{_TIMES}s²',
            'iae': output and f'{output}{_TIMES}s',
            'isu': command and f'{bracketed(command)}²{_TIMES}s',
            **dict.fromkeys(('rmse', 'max_error', 'peak_error'), output),
            **dict.fromkeys(('max_command', 'total_variation'), command),
        }
        return found.get(name, '')


def bracketed(unit: str) -> str:
    """Return a unit as one that a power can follow."""
    return f'({unit})' if set(unit) & set('/ ·*') else unit


def _rate_of(unit: str, order: int) -> str:
    power = '' if order == 1 else str(order).translate(str.maketrans('23456789', '²³⁴⁵⁶⁷⁸⁹'))
    return unit and f'{bracketed(unit)}/s{power}'


def with_unit(label: str, unit: str) -> str:
    """Return what an axis or a row is called, with its unit if that is known."""
    return f'{label} [{unit}]' if unit else label
