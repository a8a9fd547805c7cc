"""A scenario as plain data, as YAML and JSON hold it, and back."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
import os
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared, refuse_unknown_keys
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario.errors import ScenarioError
from nadrc_ros.scenario.scenario import check_controller_name, Scenario
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.simulation.experiment import Retune
from nadrc_ros.simulation.faults import CommandFault, Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.protocols import Plant
from nadrc_ros.simulation.signals import SIGNALS

KEYS = (
    'plant',
    'reference',
    'disturbance',
    'noise',
    'faults',
    'seed',
    'rate',
    'duration',
    'error',
    'settle_time',
    'limits',
    'controllers',
    'retune',
)
NEEDED = {'plant': 'plant: paper', 'reference': 'reference: cosine', 'controllers': 'controllers:'}
# Keys whose values are those of the scenario as they are.
SAME = ('rate', 'duration', 'error', 'settle_time')
FAULTS = {'measurement': MeasurementFault, 'command': CommandFault}
NOISE = ('variance', 'sample_time')
# At least so many periods, where a controller does not say otherwise.
PATIENCE = {'measurement_timeout': 5.0, 'max_dt': 10.0}
# What a signal is taken from.
SOURCES = ('signal', 'file', 'csv')
LIMITS = ('command_min', 'command_max', 'command_rate_limit')


def from_mapping(data: Mapping[Any, Any], base_dir: str | Path) -> Scenario:
    """
    Return the scenario that ``data`` describes; a plant file is sought from ``base_dir``.

    The keys are those of ``KEYS``. In a controller, ``plant_order`` and ``b0`` may be left out and
    are then those of the plant, and times of silence at least some periods; ``limits`` apply to
    every controller that does not say otherwise.

    Raises
    ------
    SettingError, ScenarioError
        What is wrong, by its dotted path.

    """
    refuse_other_kinds(data, 'scenario')
    refuse_unknown_keys(_mapping(data, ''), KEYS)
    given = {key: value for key, value in data.items() if value is not None}
    for key, example in NEEDED.items():
        if key not in given:
            raise ScenarioError(f'the key {key} is missing, for instance `{example}`')
    spec, initial_state = _plant(given['plant'], base_dir)
    limits = _limits(given.get('limits', {}))
    same = {key: given[key] for key in SAME if key in given}
    return Scenario(
        plant=spec,
        initial_state=initial_state,
        reference=_signal(given['reference'], 'reference', base_dir),
        disturbance=_signal(given.get('disturbance', 'none'), 'disturbance', base_dir),
        noise=_noise(given.get('noise', {}), given.get('seed', 0)),
        noise_signal=_noise_signal(given.get('noise', {}), base_dir),
        faults=_faults(given.get('faults', {})),
        controllers=_controllers(
            given['controllers'], limits | _patience(given.get('rate')), spec.make()
        ),
        retunes=_retunes(given.get('retune', [])),
        **same,
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
    spec = scenario.plant
    where = {'file': spec.file, 'class': spec.class_name} if spec.file else {'name': spec.name}
    noise, added = scenario.noise, scenario.noise_signal
    data = {
        'plant': {
            **{key: value for key, value in where.items() if value},
            **spec.values,
            'initial_state': scenario.initial_state,
        },
        'reference': _signal_data(scenario.reference),
        'disturbance': _signal_data(scenario.disturbance),
        'noise': {
            **{key: getattr(noise, key) for key in NOISE},
            **({} if added == SignalSpec() else _signal_data(added)),
        },
        'faults': {
            where: [_not_default(fault) for fault in getattr(scenario.faults, where)]
            for where in FAULTS
            if getattr(scenario.faults, where)
        },
        'seed': noise.seed,
        **{key: getattr(scenario, key) for key in SAME},
        'controllers': {name: _settings(s) for name, s in scenario.controllers.items()},
        'retune': [{'time': r.time, **r.settings} for r in scenario.retunes],
    }
    plain: dict[str, Any] = _plain(data)
    return plain


def _plant(data: Any, base_dir: str | Path) -> tuple[PlantSpec, Any]:
    values = _long_form(data, 'name', 'plant')
    initial_state = values.pop('initial_state', ())
    name, file, class_name = (values.pop(key, '') for key in ('name', 'file', 'class'))
    for key, value in (('name', name), ('file', file), ('class', class_name)):
        if not isinstance(value, str):
            raise SettingError(f'plant.{key}', value, 'a string')
    if bool(name) == bool(file):
        raise ScenarioError(
            'plant needs either a name, one of ' + ', '.join(PLANTS) + ', or a file'
        )
    if class_name and not file:
        raise SettingError('plant.class', class_name, 'left out: it belongs to a plant file')
    file = _absolute(file, base_dir)
    try:
        spec = PlantSpec(name=name, file=file, class_name=class_name, values=values)
    except SettingError as error:
        raise error.inside('plant') from None
    return spec, initial_state


def _signal(data: Any, path: str, base_dir: str | Path) -> SignalSpec:
    values = _long_form(data, 'signal', path)
    given = {key: values.pop(key, '') for key in (*SOURCES, 'class')}
    for key, value in given.items():
        if not isinstance(value, str):
            what = 'the name of a signal' if key == 'signal' else 'a string'
            raise SettingError(f'{path}.{key}', value, what)
    if sum(bool(given[key]) for key in SOURCES) != 1:
        raise ScenarioError(
            f'{path} needs either a signal, one of {", ".join(SIGNALS)}, a file of Python or a csv'
        )
    if given['class'] and not given['file']:
        raise SettingError(f'{path}.class', given['class'], 'left out: it belongs to a file')
    try:
        return SignalSpec(
            name=given['signal'],
            file=_absolute(given['file'], base_dir),
            class_name=given['class'],
            csv=_absolute(given['csv'], base_dir),
            values=values,
        )
    except SettingError as error:
        raise error.inside(path) from None
    except ScenarioError as error:
        raise ScenarioError(f'{path}: {error}') from None


def _signal_data(spec: SignalSpec) -> dict[str, Any]:
    where = {'signal': spec.name, 'file': spec.file, 'class': spec.class_name, 'csv': spec.csv}
    return {**{key: value for key, value in where.items() if value}, **spec.values}


def _absolute(file: str, base_dir: str | Path) -> str:
    return os.path.abspath(Path(base_dir) / Path(file).expanduser()) if file else ''


def _noise(data: Any, seed: Any) -> Noise:
    values = {key: value for key, value in _mapping(data, 'noise').items() if key in NOISE}
    build(Noise, {'seed': seed})  # a bad seed is named without the path of the noise
    return build(Noise, values | {'seed': seed}, 'noise')


def _noise_signal(data: Any, base_dir: str | Path) -> SignalSpec:
    """Return what is added to a measurement beside the random noise: any signal."""
    values = {key: value for key, value in _mapping(data, 'noise').items() if key not in NOISE}
    if not values.keys() & set(SOURCES):
        refuse_unknown_keys(values, (*NOISE, *SOURCES), 'noise')
        return SignalSpec()
    return _signal(values, 'noise', base_dir)


def _faults(data: Any) -> Faults:
    values = _mapping(data, 'faults')
    refuse_unknown_keys(values, FAULTS, 'faults')
    found: dict[str, Any] = {}
    for where, faults in values.items():
        if not isinstance(faults, list):
            raise SettingError(f'faults.{where}', faults, 'a list of {kind: ..., ...}')
        found[where] = tuple(
            build(FAULTS[where], _mapping(fault, f'faults.{where}[{i}]'), f'faults.{where}[{i}]')
            for i, fault in enumerate(faults)
        )
    return Faults(**found)


def _controllers(data: Any, limits: dict[str, Any], plant: Plant) -> dict[str, ControllerSettings]:
    controllers = {}
    for name, values in _mapping(data, 'controllers').items():
        check_controller_name(name)
        path = f'controllers.{name}'
        defaults = {'plant_order': plant.order, 'b0': float(plant.b0), **limits}
        own = _mapping({} if values is None else values, path)
        controllers[name] = build(ControllerSettings, defaults | own, path)
    return controllers


def _patience(rate: Any) -> dict[str, float]:
    """Return the times that are longer than their defaults, as they count periods."""
    if not isinstance(rate, (int, float)) or not rate > 0.0:
        return {}  # refused elsewhere
    defaults = {name: declared(ControllerSettings)[name].default for name in PATIENCE}
    return {
        name: periods / rate
        for name, periods in PATIENCE.items()
        if periods / rate > defaults[name]
    }


def _limits(data: Any) -> dict[str, Any]:
    values = _mapping(data, 'limits')
    refuse_unknown_keys(values, LIMITS, 'limits')
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
            raise ScenarioError(f'retune[{i}].time is missing')
        time = values.pop('time')
        retunes.append(build(Retune, {'time': time, 'settings': values}, f'retune[{i}]'))
    return tuple(retunes)


def _settings(settings: ControllerSettings) -> dict[str, Any]:
    """Return what differs from the defaults, and what would else come from the plant."""
    return _not_default(settings, 'plant_order', 'b0', 'structure', *PATIENCE)


def _not_default(settings: Any, *always: str) -> dict[str, Any]:
    return {
        name: getattr(settings, name)
        for name, setting in declared(type(settings)).items()
        if name in always or getattr(settings, name) != setting.default
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
