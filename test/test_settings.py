"""Settings: an invalid one is refused by name; what the declarations say is what is checked."""

from __future__ import annotations

from array import array
from typing import Any

import attrs
from hypothesis import example, given
from hypothesis import strategies as st
from law_helpers import INF, NAN
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, Declared, declared
from nadrc_ros.adrc.settings import ControllerSettings
import pytest

FIELDS = declared(ControllerSettings)
NONSENSE: tuple[Any, ...] = (
    *(None, 'nonsense', b'x', [], {}, {1.0: 2.0}, object(), 1j, NAN, INF, -INF),
    *(10**400, -(10**400), [NAN], [1.0, 'a'], [[1.0]], [10**400], [True], 1e308, True, '1'),
)
# A value that does not fit one of another setting may be refused by the name of that one.
TIED = {
    'command_min': ('safe_command',),
    'command_max': ('command_min', 'safe_command'),
    'measurement_max': ('measurement_min',),
    'reference_max': ('reference_min',),
    'reference_derivatives': ('tracking_acceleration',),
}


def acceptable(field: Declared, value: Any) -> bool:
    if field.kind == 'flag':
        return isinstance(value, bool)
    return isinstance(value, str) and (field.kind == 'text' or value in field.choices)


def test_every_field_is_declared_with_a_meaning() -> None:
    assert list(FIELDS) == [f.name for f in attrs.fields(ControllerSettings)]
    for name, field in FIELDS.items():
        assert len(field.description) > 10, name
        assert field.accepts(field.default), name
        assert field.allowed(), name
    fixed = [name for name, field in FIELDS.items() if not field.live]
    fixed_too = ['measurement_period', 'applied_timeout', 'feed_forward_timeout']
    assert fixed == ['plant_order', 'b0_source', 'reference_derivatives', *fixed_too]


@pytest.mark.parametrize('name', FIELDS)
def test_p13_nonsense_is_refused_by_name(name: str) -> None:
    for value in NONSENSE:
        if acceptable(FIELDS[name], value):
            continue
        with pytest.raises(SettingError) as refused:
            ControllerSettings(**{name: value})
        assert refused.value.name == name
        assert name in str(refused.value) and 'must be' in str(refused.value)


@pytest.mark.parametrize('name', [name for name, field in FIELDS.items() if field.low is not None])
def test_p13_the_declared_range_is_what_is_checked(name: str) -> None:
    field = FIELDS[name]
    assert field.low is not None and field.high is not None

    def wrap(value: float) -> Any:
        return (value,) if field.kind == 'numbers' else value

    beyond = 1 if field.kind == 'integer' else 1e-6
    for bound, sign in ((field.low, -1), (field.high, 1)):
        exact = int(bound) if field.kind == 'integer' else bound
        assert field.accepts(wrap(exact))
        outside = exact + sign * beyond * max(1, abs(exact))
        with pytest.raises(SettingError) as refused:
            ControllerSettings(**{name: wrap(outside)})
        assert refused.value.name == name


@given(st.one_of(st.floats(), st.integers(), st.text(), st.binary(), st.none(), st.booleans()))
@example('differentiator')
@example(200.0)
@example(-200.0)
@example(-1e15)  # the lowest of all is below nothing
def test_p13_a_setting_is_taken_or_refused_and_nothing_else(value: Any) -> None:
    for name in FIELDS:
        try:
            taken = ControllerSettings(**{name: value})
        except SettingError as error:
            assert error.name in (name, *TIED.get(name, ()))
        else:
            assert FIELDS[name].accepts(getattr(taken, name))


@pytest.mark.parametrize(
    ('values', 'name'),
    (
        ({'b0': 0.0}, 'b0'),
        ({'b0': -0.0}, 'b0'),
        ({'command_min': 5.0, 'command_max': 5.0, 'safe_command': 5.0}, 'command_min'),
        ({'command_max': -200.0}, 'command_min'),
        ({'measurement_min': 3.0, 'measurement_max': 3.0}, 'measurement_min'),
        ({'safe_command': 101.0}, 'safe_command'),
        ({'command_min': 1.0}, 'safe_command'),
        ({'pole_ratios': ()}, 'pole_ratios'),
        ({'pole_ratios': (1.0, 0.0)}, 'pole_ratios'),
        ({'fal_gains': (1.0, 2.0, 3.0)}, 'fal_gains'),
        ({'fal_exponents': (0.5,) * 3}, 'fal_exponents'),
        ({'plant_order': 2.0}, 'plant_order'),
        ({'reference_derivatives': 'differentiator'}, 'tracking_acceleration'),
        ({'reference_derivatives': 'none', 'tracking_acceleration': 5.0}, 'tracking_acceleration'),
        ({'disturbance_frequencies': (1e-200,)}, 'disturbance_frequencies'),
        ({'measurement_period': 6.28, 'error_deadband': 3.14}, 'error_deadband'),
        ({'b0_table': (1.0,)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0, 2.0)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0, 0.0, 2.0)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0, 1.0, 0.0)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0, 1.0, -2.0)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0, 1.0, 1e-16)}, 'b0_table'),
        ({'b0_table': (0.0, 1.0, 1.0, 2.0), 'b0': -1.0}, 'b0_table'),
        ({'feedback_level': '7'}, 'feedback_level'),
        ({'feedback_level': '0'}, 'feedback_level'),
    ),
)
def test_p13_what_does_not_fit_together_is_refused_by_name(
    values: dict[str, Any], name: str
) -> None:
    with pytest.raises(SettingError) as refused:
        ControllerSettings(**values)
    assert refused.value.name == name


@pytest.mark.parametrize(
    ('values', 'named', 'said'),
    (
        ({'measurement_timeout': 0.01}, 'measurement_timeout', 'at least two periods, 0.02 s'),
        ({'max_dt': 0.01}, 'max_dt', 'at least two periods, 0.02 s at 100 Hz'),
        ({'max_dt': 0.01, 'measurement_timeout': 0.01}, 'measurement_timeout', 'max_dt = 0.01'),
    ),
)
def test_p13_times_that_are_too_short_for_a_rate_are_named_together(
    values: dict[str, Any], named: str, said: str
) -> None:
    ControllerSettings(measurement_timeout=0.02, max_dt=0.02).check_rate(100.0)
    with pytest.raises(SettingError, match=named) as refused:
        ControllerSettings(**values).check_rate(100.0)
    assert said in str(refused.value)
    assert ('and so must be' in str(refused.value)) == (len(values) == 2)


def test_whole_numbers_lists_and_arrays_are_taken_as_numbers() -> None:
    given: dict[str, Any] = {'pole_ratios': [1, 2, 3], 'fal_gains': array('d', [1.0, 2.0])}
    settings = ControllerSettings(b0=2, **given)
    assert settings.b0 == 2.0 and type(settings.b0) is float
    assert settings.pole_ratios == (1.0, 2.0, 3.0) and settings.fal_gains == (1.0, 2.0)
    assert all(type(ratio) is float for ratio in settings.pole_ratios)


def test_settings_are_frozen_and_equal_by_value() -> None:
    settings = ControllerSettings(b0=2.0)
    with pytest.raises(attrs.exceptions.FrozenInstanceError):
        settings.b0 = 3.0  # type: ignore[misc]
    assert settings == ControllerSettings(b0=2) and hash(settings) == hash(
        ControllerSettings(b0=2)
    )


def test_build_names_an_unknown_key_by_its_path() -> None:
    with pytest.raises(SettingError) as refused:
        build(ControllerSettings, {'bandwith': 1.0}, 'controllers.fast')
    assert refused.value.name == 'controllers.fast.bandwith'
    with pytest.raises(SettingError) as refused:
        build(ControllerSettings, {'b0': NAN}, 'controllers.fast')
    assert refused.value.name == 'controllers.fast.b0'
    assert build(ControllerSettings, {'b0': 3}).b0 == 3.0
