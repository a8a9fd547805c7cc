"""What varies in a controller, in which range, and the designs that rules of thumb propose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import exp, inf, log
import re
from typing import Any

import attrs
from nadrc_ros.adrc.cascade import CascadeSettings, loops_of
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UnknownName
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings

_SETTINGS = declared(ControllerSettings)
_LISTS = ('fal_gains', 'fal_exponents')
_ENTRY_OF_A_LIST = re.compile(rf'({"|".join(_LISTS)})\[(\d)\]')
# The outer bandwidth varies as a share of the inner one.
_SHARE, _LEVEL = 'outer_share', 'feedback_level'
_SHARES: tuple[float, float] = (0.05, 2.0)
# Times the own value, for what no rule bounds.
_AROUND: tuple[float, float] = (0.1, 10.0)
# No bandwidth below so many over the duration settles within it.
_SLOWEST_TIMES_DURATION = 10.0
_DIGITS = 6
# The controller's bandwidth and the outer one as shares of the inner, and the level that feeds.
# Textbooks want an observer faster than the controller; under noise the reverse is often better.
_RULES = ((0.25, 0.75, 1), *((share, 0.5, 2) for share in (0.5, 1.0, 2.0, 4.0, 8.0)))
_GOLDEN_RATIO = 0.618034
# Before the names of an inner loop, which is so many times as fast by the rules.
_INNER, _INNER_FASTER = 'inner.', 4.0


@attrs.frozen
class Variable:
    """One number that varies: its name, its range, and whether it is an integer."""

    name: str
    low: float
    high: float
    whole: bool = False

    def inside(self, value: float) -> float:
        """Return ``value``, or the end of the range that it lies beyond."""
        inside = min(max(value, self.low), self.high)
        return int(inside) if self.whole else inside


def variables(
    settings: ControllerSettings,
    wanted: Mapping[str, Any],
    rate: float,
    duration: float,
    largest_wh: float,
) -> tuple[Variable, ...]:
    """
    Return what varies: ``wanted`` by name, with a range or (), or else the defaults.

    All but the level that feeds the law, and negative numbers, varies on a logarithmic scale.

    Raises
    ------
    SettingError
        For a name that cannot vary, or a range that the setting refuses.

    """
    known = default_variables(settings, rate, duration, largest_wh)
    if not wanted:
        return tuple(known.values())
    return tuple(_wanted(settings, known, name, span) for name, span in wanted.items())


def default_variables(
    settings: ControllerSettings, rate: float, duration: float, largest_wh: float
) -> dict[str, Variable]:
    """
    Return by name what the structure and the feedback of a controller leave open.

    Bandwidths [rad/s] lie between 10 / ``duration`` [s] and ``largest_wh`` times the rate [Hz],
    that of the controller from a quarter of that on. Those of the inner loop of a cascade begin
    with ``inner.``.
    """
    levels = make_design(settings).levels
    top = largest_wh * rate
    low = min(_SLOWEST_TIMES_DURATION / duration, 0.1 * top)
    found = [Variable('inner_bandwidth', low, top / max(settings.pole_ratios))]
    if levels > 1:
        found.append(Variable(_SHARE, *_SHARES))
    if levels > 2:
        found.append(Variable('bandwidth_ratio', *_SHARES))
    if settings.feedback == 'linear' or min(settings.fal_gains) == 0.0:
        found.append(Variable('controller_bandwidth', 0.25 * low, top))
    if settings.feedback == 'fal':
        gains = enumerate(settings.fal_gains)
        found += [_around(f'fal_gains[{i}]', gain) for i, gain in gains if gain > 0.0]
    if settings.structure == 'nonlinear':
        found.append(_around('eso_delta', settings.eso_delta))
    if levels > 1:
        found.append(Variable(_LEVEL, 1.0, float(levels), whole=True))
    if isinstance(settings, CascadeSettings):
        inner = default_variables(settings.inner, rate, duration, largest_wh).values()
        found += [attrs.evolve(each, name=_INNER + each.name) for each in inner]
    return {variable.name: variable for variable in found}


def _around(name: str, value: float) -> Variable:
    field = _SETTINGS[name.split('[')[0]]
    low, high = sorted(value * factor for factor in _AROUND)
    return Variable(
        name,
        max(low, -inf if field.low is None else field.low),
        min(high, inf if field.high is None else field.high),
    )


def _wanted(
    settings: ControllerSettings, known: Mapping[str, Variable], name: str, span: Any
) -> Variable:
    path, own = f'vary.{name}', _numbers_of(settings)
    if name not in known and name not in own:
        raise UnknownName(path, span, did_you_mean(name, {**own, **known}))
    if name == 'b0' and len(settings.b0_table) > 1:
        raise SettingError(path, span or 'no range', 'left out: b0 is in b0_table')
    if span == ():
        if name not in known and own[name] == 0.0:
            raise SettingError(path, 'no range', f'given a range, {name}=low:high')
        return known[name] if name in known else _around(name, own[name])
    if name.startswith(_INNER) and isinstance(settings, CascadeSettings):
        try:
            inside = {n.removeprefix(_INNER): v for n, v in known.items() if n.startswith(_INNER)}
            inner = _wanted(settings.inner, inside, name.removeprefix(_INNER), span)
        except SettingError as error:
            raise SettingError(path, error.value, error.allowed) from None
        return attrs.evolve(inner, name=name)
    low, high = span
    if low * high <= 0.0:
        raise SettingError(path, span, 'a range without 0: its scale is logarithmic')
    if name == _LEVEL:
        levels = make_design(settings).levels
        if not 1 <= low < high <= levels or low % 1 or high % 1:
            raise SettingError(path, span, f'levels from 1 to {levels}')
    elif name != _SHARE:
        field = _SETTINGS[name.split('[')[0]]
        if not attrs.evolve(field, kind='numbers').accepts((low, high)):
            raise SettingError(path, span, field.allowed())
    return Variable(name, float(low), float(high), whole=name == _LEVEL)


def _numbers_of(settings: ControllerSettings) -> dict[str, float]:
    """Return the settings that are numbers, entries of lists by their index."""
    found: dict[str, float] = {}
    for name, field in _SETTINGS.items():
        if field.kind == 'number':
            found[name] = getattr(settings, name)
        elif name in _LISTS:
            found |= {f'{name}[{i}]': entry for i, entry in enumerate(getattr(settings, name))}
    if isinstance(settings, CascadeSettings):
        found |= {_INNER + name: value for name, value in _numbers_of(settings.inner).items()}
    return found


def values_of(settings: ControllerSettings, varied: Sequence[Variable]) -> dict[str, float]:
    """Return the numbers of a controller that vary, moved into their ranges."""
    own, prefix = _numbers_of(settings), ''
    for each in loops_of(settings):
        own[prefix + _SHARE] = each.outer_bandwidth / each.inner_bandwidth
        own[prefix + _LEVEL] = 1.0 + make_design(each).feedback_level
        prefix += _INNER
    return {v.name: v.inside(own[v.name]) for v in varied}


def designed(settings: ControllerSettings, values: Mapping[str, float]) -> ControllerSettings:
    """
    Return the controller with the numbers of a design, rounded to what a file shows.

    So what was scored is what is written, and running the file gives the same figures.

    Raises
    ------
    SettingError
        When the law refuses it.

    """
    changes: dict[str, Any] = {}
    if isinstance(settings, CascadeSettings):
        inside = {n.removeprefix(_INNER): v for n, v in values.items() if n.startswith(_INNER)}
        changes['inner'] = designed(settings.inner, inside)
        values = {n: v for n, v in values.items() if not n.startswith(_INNER)}
    for name, value in values.items():
        if entry := _ENTRY_OF_A_LIST.fullmatch(name):
            entries = list(changes.get(entry[1], getattr(settings, entry[1])))
            entries[int(entry[2])] = _rounded(value)
            changes[entry[1]] = tuple(entries)
        elif name == _LEVEL:
            changes[name] = str(round(value))
        elif name != _SHARE:
            changes[name] = _rounded(value)
    if _SHARE in values:
        inner = changes.get('inner_bandwidth', settings.inner_bandwidth)
        changes['outer_bandwidth'] = _rounded(values[_SHARE] * inner)
    return attrs.evolve(settings, **changes)


def _rounded(value: float) -> float:
    return float(f'{value:.{_DIGITS}g}')


def first_designs(
    settings: ControllerSettings, varied: Sequence[Variable], count: int
) -> list[dict[str, float]]:
    """Return the controller as it is, then rules of thumb on a ladder of inner bandwidths."""
    own = values_of(settings, varied)
    inner = next((v for v in varied if v.name == 'inner_bandwidth'), None)
    found = [own]
    for i in range(count - 1):
        share, outer, level = _RULES[i % len(_RULES)]
        w = settings.inner_bandwidth
        if inner is not None:
            # The golden ratio spreads any number of bandwidths evenly, whatever the rule.
            step = _GOLDEN_RATIO * (i + 1) % 1.0
            w = exp(log(inner.low) + step * log(inner.high / inner.low))
        rule, prefix = dict[str, float](), ''
        for _ in loops_of(settings):
            rule |= {
                f'{prefix}inner_bandwidth': w,
                f'{prefix}{_SHARE}': outer,
                f'{prefix}outer_bandwidth': outer * w,
                f'{prefix}controller_bandwidth': share * w,
                f'{prefix}{_LEVEL}': float(level),
            }
            prefix, w = prefix + _INNER, _INNER_FASTER * w
        found.append({v.name: v.inside(rule.get(v.name, own[v.name])) for v in varied})
    return found
