"""The files of an export: source, header, test vectors, the program that runs them, README."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import cached_property
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from math import degrees, inf, nan
from pathlib import Path
from string import Template
from typing import Any

import attrs
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.sample import SAME
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST
from nadrc_ros.adrc.status import Cause, Mode, Status
from nadrc_ros.adrc.supervisor import PolicyState, Stall
from nadrc_ros.export.c_source import c_source, Source
from nadrc_ros.export.exportable import (
    check_exportable,
    check_single,
    exact_period,
    without_estimates,
)
from nadrc_ros.export.single import SingleTwin
from nadrc_ros.export.vectors import Call, life, Outcome
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.margins import Margins, margins
import yaml

_TEMPLATES = Path(__file__).with_name('templates')
_PERIOD_OF_VECTORS = 0.01  # [s], with measured time steps, on the average
_IN_A_BLOCK = 1000


class _Template(Template):
    delimiter = '@'


@attrs.frozen(kw_only=True, slots=False)
class Export:
    """
    An export of settings.

    Parameters
    ----------
    settings
        Of the controller; ``reference_derivatives`` auto is topics.
    rate
        Of the loop [Hz], or None where time steps are measured.
    single
        Whether it computes with float32.
    name
        What names of files and functions begin with.

    Raises
    ------
    SettingError
        As :func:`~nadrc_ros.export.exportable.check_exportable`.

    """

    settings: ControllerSettings = attrs.field(converter=without_estimates)
    rate: float | None
    single: bool = False
    name: str = 'nadrc'
    ticks: int = 10_000

    def __attrs_post_init__(self) -> None:
        check_exportable(self.settings, self.rate)
        if self.single:
            check_single(self.settings, self.rate)

    @cached_property
    def period(self) -> float | None:
        """Return the period that the C counts with [s], 1 / rate but for its last digits."""
        return None if self.rate is None else exact_period(self.rate, self.single)

    @cached_property
    def design(self) -> Design:
        """Return the design that is exported."""
        return make_design(self.settings)

    @cached_property
    def source(self) -> Source:
        """Return the law of the design in C."""
        return c_source(self.design, self.period, 'float' if self.single else 'double', self.name)

    @cached_property
    def vectors(self) -> tuple[list[Call], list[Outcome]]:
        """Return the calls of the self test, and what has to come of them."""
        period = self.period or _PERIOD_OF_VECTORS
        twin = SingleTwin(self.settings, period, self.source) if self.single else None
        return life(self.settings, period, self.rate is None, self.ticks, twin)

    @cached_property
    def off(self) -> float:
        """How far the command with float32 is off at most, as a share of its range."""
        _, exact = life(self.settings, self.period or _PERIOD_OF_VECTORS, ticks=self.ticks)
        span = self.settings.command_max - self.settings.command_min
        pairs = zip(self.vectors[1], exact)
        return max((abs(own.command - other.command) / span for own, other in pairs), default=0.0)

    @cached_property
    def parameters(self) -> str:
        """All settings as YAML, of which the header has the hash."""
        values = {name: getattr(self.settings, name) for name in declared(ControllerSettings)}
        plain = {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
        return yaml.safe_dump({**plain, 'rate': self.rate}, sort_keys=False)

    @cached_property
    def margins(self) -> Margins | None:
        """Return the margins with the plant y^(n) = b0 u, where the rate is known."""
        if self.period is None:
            return None
        return margins(self.design, chain(self.design.order, self.design.b0), self.period)

    @property
    def warning(self) -> str:
        """Return what is wrong with the loop, empty if nothing is known to be."""
        if self.margins is None or self.margins.modulus > 0.0:
            return ''
        plant = f'y^({self.design.order}) = b0 u'
        return f'the loop is unstable at {self.rate:g} Hz with the plant {plant}'

    def files(self) -> dict[str, str]:
        """Return the text of each file by its name."""
        words = self._words()
        names = {
            f'{self.name}.h': 'api.h',
            f'{self.name}.c': 'source.c',
            'test_vectors.h': 'vectors.h',
            'self_test.c': 'self_test.c',
            'CMakeLists.txt': 'CMakeLists.txt',
            'README.md': 'README.md',
        }
        return {
            name: _Template((_TEMPLATES / template).read_text(encoding='utf-8')).substitute(words)
            for name, template in names.items()
        }

    def about(self) -> list[str]:
        """Return what there is to say about the design."""
        settings, design, found = self.settings, self.design, self.margins
        at = 'time steps as measured' if self.rate is None else f'{self.rate:g} Hz'
        bandwidths = ' / '.join(f'{w:.4g}' for w in design.bandwidths)
        lines = [
            f'Design: {settings.structure}, order {design.order}, observers at {bandwidths} '
            f'rad/s, controller at {settings.controller_bandwidth:g} rad/s, b0 {settings.b0:g}, '
            f'{at}.'
        ]
        if found is not None and not self.warning:
            delay = 'any' if found.delay == inf else f'{1e3 * found.delay:.3g} ms'
            lines.append(
                f'Margins with the plant y^({design.order}) = b0 u: gain times '
                f'{found.gain_low:.3g} to {found.gain_high:.3g}, phase '
                f'{degrees(found.phase):.0f} degrees, delay {delay}.'
            )
        elif self.warning:
            lines.append(f'WARNING: {self.warning}.')
        real = 4 if self.single else 8
        state = _size(self.source.numbers, design.order + 1, real)
        tables = real * _count([*self.source.arrays.values()])
        lines.append(
            f'Size: {state} bytes for each controller'
            + (f', and {tables} bytes of tables for all.' if tables else '.')
        )
        if self.single:
            lines.append(
                f'With float the command is off that with double by at most {self.off:.1e} of its '
                'range, over the test vectors.'
            )
        lines.append(f'By nadrc_ros {_version()}; sha256 of the parameters in README.md:')
        lines.append(sha256(self.parameters.encode()).hexdigest())
        return lines

    def _words(self) -> dict[str, object]:
        settings, design, period, single = self.settings, self.design, self.period, self.single
        source = self.source
        real = 'float' if single else 'double'
        literal = source.literal
        references = 1 + settings.received_derivatives
        size = design.order + 1
        measured = self.rate is None
        about = self.about()
        calls, outcomes = self.vectors
        derivatives = ('', ", r'", ", r' and r''")[references - 1]
        uses_libm = measured or any(f'{name}{"f" * single}(' in source.functions for name in _LIBM)
        clock = (
            'dt is the time since the call before [s], measured; max_dt is in it'
            if measured
            else f'Both count periods: call one of the two every {1.0 / (self.rate or 1.0):g} s'
        )
        return {
            'name': self.name,
            'NAME': self.name.upper(),
            'F': 'f' if single else '',
            'title': f'{self.name}: a controller of nadrc_ros',
            'version': _version(),
            'about': '\n'.join(f' * {line}' for line in about),
            'about_markdown': ' '.join(about[:-1]) + f' `{about[-1]}`.',
            'parameters': self.parameters.rstrip(),
            'real': real,
            'DIGITS': 'FLT' if single else 'DBL',
            'digits': 24 if single else 53,
            'bits': 32 if single else 64,
            'wide_evaluation': '(FLT_EVAL_METHOD < 0) || (FLT_EVAL_METHOD == 2)'
            + (' || (FLT_EVAL_METHOD == 1)' if single else ''),
            'period': literal(period) if period is not None else 'NAN',
            'period_macro': ''
            if period is None
            else f'/* The period [s]. */\n#define {self.name.upper()}_PERIOD {literal(period)}\n',
            'order': design.order,
            'size': size,
            'references': references,
            'derivatives': derivatives,
            'reference_given': '&r' if references == 1 else 'r',
            'references_text': 'one number'
            if references == 1
            else f'{references} numbers, r{derivatives}, NaN for a derivative that is unknown',
            'good_samples': design.good_samples,
            'per_call': 'each time' if measured else 'a period',
            'times_text': clock + '.',
            'dt_text': '\n *   dt         time since the call before [s]' if measured else '',
            'dt_parameter': f', {real} dt' if measured else '',
            'dt_given': ', call->dt' if measured else '',
            'dt_here': ', dt' if measured else '',
            'dt_member': f'\n    {real} dt;' if measured else '',
            'elapsed': f'(dt > {literal(0.0)}) ? dt : {literal(0.0)}' if measured else 'PERIOD',
            'nan': literal(nan),
            'zero': literal(0.0),
            'one': literal(1.0),
            'half': literal(0.5),
            'small': literal(2.0**-13 if single else 2.0**-30),
            'least': 'FLT_MIN' if single else 'DBL_MIN',
            'highest': literal(HIGHEST),
            'safe_command': literal(design.safe_command),
            'same': literal(SAME),
            'max_dt': literal(design.max_dt),
            **{
                key: literal(getattr(design, key))
                for key in ('reference_min', 'reference_max', 'measurement_min', 'measurement_max')
            },
            'take_derivatives': _take_derivatives(design.order, references, literal(0.0)),
            'law_members': source.members,
            'stall_members': _members(Stall, self.name, real),
            'policy_members': _members(PolicyState, self.name, real),
            'statuses': _enumerators(Status, f'{self.name.upper()}_STATUS'),
            'modes': _enumerators(Mode, f'{self.name.upper()}_MODE'),
            'causes': _enumerators(Cause, f'{self.name.upper()}_CAUSE'),
            'blank': _blank(source),
            'tables': source.tables,
            'functions': source.functions,
            'tick_call': source.tick_call,
            'adopt_call': source.adopt_call,
            'libm_text': '' if uses_libm else ', no libm',
            'lm': ' -lm' if uses_libm else '',
            'same_as': 'nadrc_ros in Python with float32'
            if single
            else 'the controller node of nadrc_ros',
            'link': f'\ntarget_link_libraries({self.name} PUBLIC m)' if uses_libm else '',
            'ticks': len(calls),
            'rows': _rows(self.name, calls, outcomes, references, measured, literal),
        }


# What an export may call of the C library's mathematics.
_LIBM = ('exp', 'expm1', 'pow', 'sqrt')


def _version() -> str:
    try:
        return version('nadrc_ros')
    except PackageNotFoundError:
        return '(a source tree)'


def _size(numbers: int, references: int, real: int) -> int:
    """Return what the struct of a controller takes: reals aligned to their size, ints of 4."""
    policy = 8 + 4 * real + max(4, real) + 6 * real
    whole = 2 * numbers * real + policy + (2 * references + 4) * real + 16
    return whole


def _count(table: list[Any]) -> int:
    return sum(_count(each) if isinstance(each, list) else 1 for each in table)


def _members(cls: Any, name: str, real: str) -> str:
    lines = []
    for field, reference in cls.__annotations__.items():
        kind = getattr(reference, '__forward_arg__', reference)
        kind = {'float': real, 'Stall': f'{name}_stall'}.get(kind, kind)
        lines.append(f'    {kind} {field};')
    return '\n'.join(lines)


def _enumerators(cls: type[IntEnum], prefix: str) -> str:
    return ',\n'.join(f'    {prefix}_{each.name} = {each.value}' for each in cls)


def _take_derivatives(order: int, references: int, zero: str) -> str:
    lines = []
    for i in range(1, order + 1):
        pad = ' ' * 8
        if i < references:
            lines += [
                f'{pad}if ((reference[{i}] >= -HIGHEST) && (reference[{i}] <= HIGHEST))',
                f'{pad}{{',
                f'{pad}    self->reference[{i}] = reference[{i}];',
                f'{pad}    self->ages[{i}] = {zero};',
                f'{pad}}}',
            ]
        else:
            lines += [f'{pad}self->reference[{i}] = {zero};', f'{pad}self->ages[{i}] = {zero};']
    return '\n'.join(lines)


def _blank(source: Source) -> str:
    """Return what is not 0 of a controller that has seen nothing."""
    before = PolicyState()
    literal = source.literal
    ages = ('measurement_age', 'reference_age', 'last')
    policy = [f'.mode = {before.mode}', f'.cause = {before.cause}']
    policy += [f'.{each} = {literal(getattr(before, each))}' for each in ages]
    lines = [
        f'.policy = {{{", ".join(policy)}}}',
        f'.applied = {literal(nan)}',
        f'.applied_age = {literal(inf)}',
        '.enabled = true',
        f'.status = {int(Status.NO_MEASUREMENT)}',
    ]
    return ',\n'.join(f'        {line}' for line in lines)


def _rows(
    name: str,
    calls: Sequence[Call],
    outcomes: Sequence[Outcome],
    references: int,
    measured: bool,
    literal: Callable[[float], str],
) -> str:
    lines = []
    for i, (call, outcome) in enumerate(zip(calls, outcomes)):
        if i > 0 and i % _IN_A_BLOCK == 0:
            lines += ['#endif'] * (i > _IN_A_BLOCK) + [f'#if {name.upper()}_TEST_CALLS > {i}']
        given = [*call.reference, *[0.0] * (references - len(call.reference))]
        reals = [literal(call.y), f'{{{", ".join(map(literal, given))}}}', literal(call.applied)]
        reals += [literal(call.dt)] * measured + [literal(outcome.command)]
        integers = call.action, int(bool(call.reference)), *outcome[1:]
        lines.append(f'    {{{", ".join([*reals, *map(str, integers)])}}},')
    return '\n'.join(lines + ['#endif'] * (len(calls) > _IN_A_BLOCK))
