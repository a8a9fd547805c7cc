"""What a page is told of a loop: its signals and parameters, and how it is."""

from __future__ import annotations

from math import isfinite, nan
import time
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST
from nadrc_ros.live.monitor import Monitor, Report
from nadrc_ros.live.outbox import Message
from nadrc_ros.live.plant_faults import listed
from nadrc_ros.nodes.loop_settings import LoopSettings
from nadrc_ros.ros.pacing import PacingSettings
from nadrc_ros.ros.wiring_parameters import wiring_fields
from nadrc_ros.scenario.units import Units
from rclpy.parameter import Parameter

PROTOCOL = 1
_ROLES = {
    'reference': ('reference', 'reference r'),
    'measurement': ('measurement', 'measurement y'),
    'tracking': ('tracking', 'reference that is followed'),
    'output_estimate': ('output_estimate', 'estimate of the output'),
    'command': ('command', 'command u'),
    'disturbance_estimate': ('disturbance', 'estimated total disturbance'),
    'output': ('output', 'true output'),
    'total_disturbance': ('truth', 'true total disturbance'),
    'applied': ('applied', 'command that really acts'),
}
# What an operator changes while a loop runs, and what bounds the command.
_TUNED = ('controller_bandwidth', 'inner_bandwidth', 'outer_bandwidth', 'bandwidth_ratio', 'b0')
_LIMITS = ('command_min', 'command_max', 'command_rate_limit', 'safe_command')
_KINDS = {
    Parameter.Type.DOUBLE.value: 'number',
    Parameter.Type.INTEGER.value: 'integer',
    Parameter.Type.BOOL.value: 'flag',
    Parameter.Type.DOUBLE_ARRAY.value: 'numbers',
}
# The middleware's own parameters are none of the operator's.
_FOREIGN = ('qos_overrides.', 'use_sim_time', 'start_type_description_service')
# A controller reports every second; what it said so long ago is no news [s].
STALE = 3.0
_LEVELS = ('ok', 'warn', 'error', 'stale')


def hello(monitor: Monitor) -> Message:
    """Return the description of a loop, without what differs between pages."""
    simulated, plant = monitor.simulated, monitor.parameters(monitor.plant)
    values = monitor.parameters(monitor.controller)
    settings = monitor.controller_settings()
    units, order = units_of(monitor), settings.plant_order if settings else 0
    rate = values.get('rate')
    return {
        'type': 'hello',
        'protocol': PROTOCOL,
        'node': monitor.controller if values else None,
        'plant': monitor.plant if simulated else None,
        'began': monitor.began.isoformat(),
        't': monitor.now(),
        'signals': [_signal(name, units, order) for name in monitor.signals],
        'parameters': [_parameter(monitor, name, value) for name, value in shown(values)],
        'limits': {
            'low': _limit(values.get('command_min'), LOWEST),
            'high': _limit(values.get('command_max'), HIGHEST),
        },
        'read_only': monitor.settings.read_only,
        'simulated': simulated,
        'hold_to_run': not simulated,
        'faults': listed(plant) if simulated and not monitor.settings.read_only else [],
        'rate': rate if isinstance(rate, float) else None,
    }


def shown(values: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return the parameters of a controller that a page shows, with their values."""
    return [each for each in values.items() if not each[0].startswith(_FOREIGN)]


def units_of(monitor: Monitor) -> Units:
    """Return the units that the recorder was told."""
    told = monitor.parameters(monitor.recorder)
    try:
        return Units(**{name: told[f'units.{name}'] for name in declared(Units)})
    except (KeyError, UserError):
        return Units()


def _signal(name: str, units: Units, order: int) -> Message:
    level = name.removeprefix('level_')
    role, text = _ROLES.get(name, ('level', f'estimate of level {level}'))
    column = {'disturbance_estimate': 'estimate', 'total_disturbance': 'truth'}.get(name, name)
    return {
        'name': name,
        'text': text,
        'role': role,
        'unit': units.command if name == 'applied' else units.of(column, order),
    }


def _limit(value: Any, none: float) -> float | None:
    return value if isinstance(value, float) and value != none else None


def _parameter(monitor: Monitor, name: str, value: Any) -> Message:
    """Return what is known of a parameter: by our declaration, else by its descriptor."""
    known: Declared | None = _DECLARED.get(name)
    descriptor = monitor.descriptors.get(name)
    found: Message = {'name': name, 'value': value, 'group': _group(name)}
    if known is not None:
        found |= {
            'kind': known.kind,
            'default': known.default,
            'low': known.low,
            'high': known.high,
            'choices': list(known.choices),
            'unit': known.unit,
            'text': known.description,
            'live': known.live,
        }
    else:
        found |= dict.fromkeys(('default', 'low', 'high'))
        found |= {'kind': 'text', 'choices': [], 'unit': '', 'text': '', 'live': False}
    if descriptor is not None:
        unit = f' [{found["unit"]}]'
        found |= {
            'text': str(descriptor.description).removesuffix(unit),
            'live': not descriptor.read_only,
        }
        if known is None:
            found['kind'] = _KINDS.get(descriptor.type, 'text')
        for span in (*descriptor.floating_point_range, *descriptor.integer_range):
            found |= {'low': span.from_value, 'high': span.to_value}
    return found


def _group(name: str) -> str:
    return 'tune' if name in _TUNED else 'limits' if name in _LIMITS else 'other'


_DECLARED = {
    **declared(ControllerSettings),
    **declared(LoopSettings),
    **declared(PacingSettings),
    **wiring_fields(),
}


class Rate:
    """The steps per second of a controller, by what it counted from one report to the next."""

    def __init__(self) -> None:
        self.value = nan
        self._last: Report | None = None

    def note(self, report: Report) -> None:
        """Note a report, which may be the last one again."""
        last = self._last
        if last is not None and report.time - last.time < 0.5:
            return
        self._last = report
        counted = number(report.values.get('periods'))
        before = None if last is None else number(last.values.get('periods'))
        if last is None or counted is None or before is None:
            return
        started_anew = counted < before
        self.value = nan if started_anew else (counted - before) / (report.time - last.time)


def number(text: str | None) -> float | None:
    """Return a number that a report has, None for none."""
    try:
        found = float(text or '')
    except ValueError:
        return None
    return found if isfinite(found) else None


def state(monitor: Monitor, rate: Rate) -> Message:
    """Return how the controller is."""
    report = monitor.reports.get(monitor.controller)
    found: Message = {'type': 'state', 't': monitor.now(), 'mode': 'unknown', 'cause': 'unknown'}
    silent = monitor.absent or f'{monitor.controller} was not heard yet'
    found |= {'text': silent, 'level': 'stale'}
    found |= dict.fromkeys(('enabled', 'rate', 'latency', 'latency_p99', 'missed', 'periods'))
    found |= {'experiment': monitor.experiment, 'commissioned': monitor.commissioned}
    nominal = monitor.parameters(monitor.controller).get('rate')
    found |= {'nominal': nominal if isinstance(nominal, float) else None, 'age': None}
    if report is None:
        return found
    rate.note(report)
    values, age = report.values, time.monotonic() - report.time
    found |= {
        'mode': values.get('mode', 'unknown'),
        'cause': values.get('cause', 'unknown'),
        'text': report.text,
        'level': _LEVELS[min(report.level, 3)] if age < STALE else 'stale',
        'enabled': {'True': True, 'False': False}.get(values.get('enabled', '')),
        'rate': rate.value,
        'latency': number(values.get('latency_median_ms')),
        'latency_p99': number(values.get('latency_p99_ms')),
        'missed': number(values.get('missed_periods')),
        'periods': number(values.get('periods')),
        'age': age,
    }
    if age >= STALE:
        found['text'] = f'nothing heard of {monitor.controller} for {age:.0f} s'
    return found
