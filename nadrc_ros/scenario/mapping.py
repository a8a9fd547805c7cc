"""A scenario as plain data, as YAML and JSON hold it, and back."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
import os
from pathlib import Path
from typing import Any, TypeVar

import attrs
from nadrc_ros.adrc.cascade import CascadeSettings
from nadrc_ros.adrc.errors import SettingError, UnknownName
from nadrc_ros.adrc.fields import build, declared, refuse_unknown_keys
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.scenario.units import Units
from nadrc_ros.scenario.user_code import ScenarioError
from nadrc_ros.simulation.experiment import Conditions, Retune
from nadrc_ros.simulation.faults import CommandFault, Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.protocols import Plant
from nadrc_ros.simulation.sensor import refuse_one_end, Sensor

S = TypeVar('S', PlantSpec, SignalSpec)
# Keys whose values are those of the scenario as they are.
_SAME = ('rate', 'duration', 'error', 'reference_alone', 'reference_rate', 'settle_time')
_KEYS = (
    *(
        'plant',
        'reference',
        'disturbance',
        'feed_forward',
        'noise',
        'sensor',
        'faults',
        'seed',
        'units',
        *_SAME,
    ),
    *('limits', 'controllers', 'retune'),
)
_NEEDED = {
    'plant': 'plant: paper',
    'reference': 'reference: cosine',
    'controllers': 'controllers:',
}
_FAULTS = {'measurement': MeasurementFault, 'command': CommandFault}
_RANDOM_NOISE = ('variance', 'sample_time', 'derivative_variances')
_SOURCES = tuple(key for key in SignalSpec.keys if key != 'class')
_INPUT_DELAY = declared(Conditions)['input_delay']
_LIMITS = ('command_min', 'command_max', 'command_rate_limit')
# At least so many periods, where a controller does not say otherwise.
_FEWEST_PERIODS = {'measurement_timeout': 5.0, 'max_dt': 10.0}


def from_mapping(data: Mapping[Any, Any], base_dir: str | Path) -> Scenario:
    """
    Return the scenario that ``data`` describes; a plant file is sought from ``base_dir``.

    In a controller, ``plant_order`` and ``b0`` may be left out and
    are then those of the plant, and times of silence at least some periods; ``limits`` apply to
    every controller that does not say otherwise. One with ``inner`` settings is a cascade: the
    limits are those of the innermost loop, its order and b0 what the loops around it, by default
    of order 1 and b0 = 1, leave of the plant.

    Raises
    ------
    SettingError, ScenarioError
        What is wrong, by its dotted path.

    """
    refuse_other_kinds(data, 'scenario')
    refuse_unknown_keys(_mapping(data, ''), _KEYS)
    given = {key: value for key, value in data.items() if value is not None}
    for key, example in _NEEDED.items():
        if key not in given:
            raise ScenarioError(f'the key {key} is missing, for instance `{example}`')
    plant_values = _long_form(given['plant'], 'name', 'plant')
    initial_state = plant_values.pop('initial_state', ())
    input_delay = plant_values.pop('input_delay', 0.0)
    if not _INPUT_DELAY.accepts(input_delay):
        raise SettingError('plant.input_delay', input_delay, _INPUT_DELAY.allowed())
    plant = _spec(PlantSpec, plant_values, 'plant', base_dir)
    noise, noise_signal = _noise(given.get('noise', {}), given.get('seed', 0), base_dir)
    limits = _limits(given.get('limits', {})) | _times_of_periods(given.get('rate'))
    return Scenario(
        plant=plant,
        initial_state=initial_state,
        input_delay=input_delay,
        reference=_spec(SignalSpec, given['reference'], 'reference', base_dir),
        disturbance=_spec(SignalSpec, given.get('disturbance', 'none'), 'disturbance', base_dir),
        feed_forward=_spec(
            SignalSpec, given.get('feed_forward', 'none'), 'feed_forward', base_dir
        ),
        noise=noise,
        noise_signal=noise_signal,
        sensor=_sensor(given.get('sensor', {})),
        faults=_faults(given.get('faults', {})),
        controllers=_controllers(given['controllers'], limits, plant.make()),
        retunes=_retunes(given.get('retune', [])),
        units=build(Units, _texts(given.get('units', {})), 'units'),
        **{key: given[key] for key in _SAME if key in given},
    )


def refuse_other_kinds(data: Mapping[Any, Any], wanted: str) -> None:
    """
    Refuse a file of another kind as such, where ``wanted`` is a scenario or a sweep.

    Raises
    ------
    ScenarioError
        Says what it is.

    """
    if _of_a_node(data):
        raise ScenarioError(f'these are parameters of a node, not a {wanted}')
    if wanted == 'scenario' and 'scenario' in data and 'controllers' not in data:
        raise ScenarioError('this is a sweep, not a scenario: nadrc sweep runs it')
    if wanted == 'sweep' and 'controllers' in data and 'scenario' not in data:
        raise ScenarioError('this is a scenario, not a sweep; a sweep names one, and what varies')


def _of_a_node(data: Any) -> bool:
    return isinstance(data, Mapping) and (
        'ros__parameters' in data or any(map(_of_a_node, data.values()))
    )


def to_mapping(scenario: Scenario) -> dict[str, Any]:
    """Return plain data from which :func:`from_mapping` makes an equal scenario."""
    noise, added, fed = scenario.noise, scenario.noise_signal, scenario.feed_forward
    data = {
        'plant': {
            **scenario.plant.as_given(),
            'initial_state': scenario.initial_state,
            **({'input_delay': scenario.input_delay} if scenario.input_delay else {}),
        },
        'reference': scenario.reference.as_given(),
        'disturbance': scenario.disturbance.as_given(),
        **({} if fed == SignalSpec() else {'feed_forward': fed.as_given()}),
        'noise': {
            **_not_default(noise, 'variance', 'sample_time', without='seed'),
            **({} if added == SignalSpec() else added.as_given()),
        },
        'sensor': {} if scenario.sensor == Sensor() else attrs.asdict(scenario.sensor),
        'faults': {
            where: [_not_default(fault) for fault in getattr(scenario.faults, where)]
            for where in _FAULTS
            if getattr(scenario.faults, where)
        },
        'seed': noise.seed,
        **({'units': units} if (units := _not_default(scenario.units)) else {}),
        **{key: getattr(scenario, key) for key in _SAME},
        'controllers': {name: _settings(s) for name, s in scenario.controllers.items()},
        'retune': [{'time': r.time, **r.settings} for r in scenario.retunes],
    }
    plain: dict[str, Any] = _plain(data)
    return plain


def _spec(cls: type[S], data: Any, path: str, base_dir: str | Path) -> S:
    """Return what ``data`` says of a plant or a signal: a bare name, or a mapping."""
    first, *_ = cls.keys
    values = _long_form(data, first, path)
    given = {key: values.pop(key, '') for key in cls.keys}
    for key, value in given.items():
        if not isinstance(value, str):
            allowed = 'the name of a signal' if key == 'signal' else 'a string'
            raise SettingError(f'{path}.{key}', value, allowed)
    if sum(bool(value) for key, value in given.items() if key != 'class') != 1:
        known = ', '.join(cls.kind.known)
        raise ScenarioError(f'{path} needs either a {first}, one of {known}, {cls.others}')
    if given['class'] and not given['file']:
        raise SettingError(f'{path}.class', given['class'], 'left out: it belongs to a file')
    for key in given.keys() & {'file', 'csv'}:
        if given[key]:
            given[key] = os.path.abspath(Path(base_dir) / Path(given[key]).expanduser())
    try:
        return cls(**{field: given[key] for key, field in cls.keys.items()}, values=values)
    except SettingError as error:
        raise error.inside(path) from None
    except ScenarioError as error:
        raise ScenarioError(f'{path}: {error}') from None


def _noise(data: Any, seed: Any, base_dir: str | Path) -> tuple[Noise, SignalSpec]:
    """Return the random noise, and what is added to a measurement beside it: any signal."""
    build(Noise, {'seed': seed})  # a bad seed is named without the path of the noise
    values = _mapping(data, 'noise')
    random = {key: values.pop(key) for key in _RANDOM_NOISE if key in values}
    noise = build(Noise, random | {'seed': seed}, 'noise')
    if values.keys() & set(_SOURCES):
        try:
            return noise, _spec(SignalSpec, values, 'noise', base_dir)
        except UnknownName as error:  # from a signal, which knows only its own keys
            allowed = f'{error.allowed}; of the random noise {", ".join(_RANDOM_NOISE)}'
            raise UnknownName(error.name, error.value, allowed) from None
    refuse_unknown_keys(values, (*_RANDOM_NOISE, *_SOURCES), 'noise')
    return noise, SignalSpec()


def _sensor(data: Any) -> Sensor:
    values = _mapping(data, 'sensor')
    try:
        refuse_one_end(values)
    except SettingError as error:
        raise error.inside('sensor') from None
    return build(Sensor, values, 'sensor')


def _faults(data: Any) -> Faults:
    values = _mapping(data, 'faults')
    refuse_unknown_keys(values, _FAULTS, 'faults')
    found: dict[str, Any] = {}
    for where, faults in values.items():
        if not isinstance(faults, list):
            raise SettingError(f'faults.{where}', faults, 'a list of {kind: ..., ...}')
        found[where] = tuple(
            build(_FAULTS[where], _mapping(fault, f'faults.{where}[{i}]'), f'faults.{where}[{i}]')
            for i, fault in enumerate(faults)
        )
    return Faults(**found)


def _controllers(data: Any, limits: dict[str, Any], plant: Plant) -> dict[str, ControllerSettings]:
    controllers = {}
    for name, values in _mapping(data, 'controllers').items():
        path = f'controllers.{name}'
        defaults = {'plant_order': plant.order, 'b0': float(plant.b0), **limits}
        own = _mapping({} if values is None else values, path)
        controllers[name] = _controller(own, defaults, path)
    return controllers


def _controller(own: dict[str, Any], defaults: dict[str, Any], path: str) -> ControllerSettings:
    """Return a controller; ``defaults`` are of the innermost loop, if it is a cascade."""
    if 'inner' not in own:
        return build(ControllerSettings, defaults | own, path)
    around = {key: value for key, value in defaults.items() if key in _FEWEST_PERIODS}
    around = {'plant_order': 1, 'b0': 1.0, **around, **own}
    order = around['plant_order']
    left = defaults['plant_order'] - order if isinstance(order, int) else 1
    if not left > 0:
        allowed = 'less than the order of the plant: the inner loop needs some of it'
        raise SettingError(f'{path}.plant_order', order, allowed)
    inside = f'{path}.inner'
    inner = _mapping({} if own['inner'] is None else own['inner'], inside)
    around['inner'] = _controller(inner, defaults | {'plant_order': left}, inside)
    return build(CascadeSettings, around, path)


def _times_of_periods(rate: Any) -> dict[str, float]:
    """Return the times that are longer than their defaults, as they count periods."""
    if not isinstance(rate, (int, float)) or not rate > 0.0:
        return {}  # refused elsewhere
    times = {name: periods / rate for name, periods in _FEWEST_PERIODS.items()}
    defaults = declared(ControllerSettings)
    return {name: time for name, time in times.items() if time > defaults[name].default}


def _limits(data: Any) -> dict[str, Any]:
    values = _mapping(data, 'limits')
    refuse_unknown_keys(values, _LIMITS, 'limits')
    for key, value in values.items():
        setting = declared(ControllerSettings)[key]
        if not setting.accepts(value):
            raise SettingError(f'limits.{key}', value, setting.allowed())
    low, high = values.get('command_min', -inf), values.get('command_max', inf)
    if not low < high:
        raise SettingError('limits.command_min', low, f'below command_max = {high!r}')
    return values


def _retunes(data: Any) -> tuple[Retune, ...]:
    if not isinstance(data, list):
        raise SettingError('retune', data, 'a list of {time: ..., <setting>: ...}')
    retunes = []
    for i, item in enumerate(data):
        values = _mapping(item, f'retune[{i}]')
        if 'time' not in values:
            there = ', '.join(map(str, values)) or 'nothing'
            raise ScenarioError(f'retune[{i}].time is missing; there is {there}')
        time = values.pop('time')
        retunes.append(build(Retune, {'time': time, 'settings': values}, f'retune[{i}]'))
    return tuple(retunes)


def _texts(data: Any) -> dict[str, str]:
    values = _mapping(data, 'units')
    for key, value in values.items():
        if not isinstance(value, str):
            raise SettingError(f'units.{key}', value, "text, in quotes: '1', '%'")
    return values


def _settings(settings: ControllerSettings) -> dict[str, Any]:
    """Return what differs from the defaults, and what would else come from the plant."""
    own = _not_default(settings, 'plant_order', 'b0', 'structure', *_FEWEST_PERIODS)
    inner = {'inner': _settings(settings.inner)} if isinstance(settings, CascadeSettings) else {}
    return own | inner


def _not_default(settings: Any, *always: str, without: str = '') -> dict[str, Any]:
    return {
        name: getattr(settings, name)
        for name, setting in declared(type(settings)).items()
        if name != without and (name in always or getattr(settings, name) != setting.default)
    }


def _long_form(data: Any, key: str, path: str) -> dict[str, Any]:
    return {key: data} if isinstance(data, str) else _mapping(data, path)


def _mapping(data: Any, path: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise SettingError(path, data, 'a mapping of keys to values')
    for key, value in data.items():
        if not isinstance(key, str) or not key.isprintable():
            error = SettingError(
                repr(key), value, 'left out: a key is a word, in quotes if YAML reads it otherwise'
            )
            raise error.inside(path)
    return dict(data)


def _plain(value: Any) -> Any:
    """Return ``value`` in the types that YAML and JSON know: also a NumPy number, a tuple."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    for kind in (bool, int, float):
        if isinstance(value, kind):
            return kind(value)
    return value
