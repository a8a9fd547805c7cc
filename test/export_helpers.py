"""Exports, compiled and called from Python."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import byref, c_bool, c_char, c_double, CDLL, POINTER
from math import nan
from pathlib import Path
import subprocess
from typing import Any

from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.export.exportable import exact_period
from nadrc_ros.export.files import Export
from nadrc_ros.export.twin import Twin
from nadrc_ros.export.vectors import Call, DISABLE, ENABLE, INIT, NO_SAMPLE, Outcome

STRICT = ('-Wall', '-Wextra', '-Wconversion', '-Wdouble-promotion', '-pedantic', '-Werror')
RATE = 200.0
# Every structure, n = 1..5, K = 1..6, both laws, with and without the differentiator.
SHAPES: dict[str, dict[str, Any]] = {
    'nested': {'command_rate_limit': 40.0, 'reference_timeout': 0.1},
    'nested_six': {'levels': 6, 'plant_order': 1, 'reference_derivatives': 'none'},
    'cascade_fal': {'structure': 'cascade', 'levels': 3, 'plant_order': 3, 'feedback': 'fal'},
    'conventional': {
        'structure': 'conventional',
        'plant_order': 4,
        'pole_ratios': (1.0, 1.3, 0.7),
        'command_rate_limit': 40.0,
    },
    'filtered': {'structure': 'filtered', 'error_based': True, 'stall_time': 0.02},
    'generalized': {'structure': 'generalized', 'plant_order': 3, 'extended_states': 3},
    'nonlinear': {'structure': 'nonlinear', 'levels': 2, 'plant_order': 2, 'b0': -2.0},
    'printed_td': {
        'structure': 'printed',
        'tracking_acceleration': 5.0,
        'command_rate_limit': 40.0,
        'feedback': 'fal',
    },
    'five_td': {
        'plant_order': 5,
        'levels': 4,
        'tracking_acceleration': 20.0,
        'feedback_level': 'outer',
        'observer_gain_factor': 0.5,
        'error_based': True,
    },
    'narrow': {
        'plant_order': 1,
        'levels': 1,
        'measurement_min': -2.0,
        'measurement_max': 3.0,
        'reference_min': -1.0,
        'reference_max': 1.0,
        'good_samples': 1,
        'stall_time': 0.02,
        'stall_action': 'fault',
    },
    'measured': {'startup_time': 0.1, 'command_rate_limit': 40.0},
    'measured_nonlinear': {'structure': 'nonlinear', 'levels': 3, 'plant_order': 1},
}
_COMMON: dict[str, Any] = {
    'command_min': -20.0,
    'command_max': 30.0,
    'safe_command': 1.0,
    'max_dt': 0.1,
    'measurement_timeout': 0.05,
    'hold_time': 0.03,
}


def export_of(shape: str) -> Export:
    settings = ControllerSettings(**(_COMMON | SHAPES[shape]))
    return Export(settings=settings, rate=None if measured(shape) else RATE, name=shape, ticks=0)


def measured(shape: str) -> bool:
    return shape.startswith('measured')


def write(export: Export, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for name, text in export.files().items():
        (folder / name).write_text(text, encoding='utf-8')


def compiled(
    folder: Path, *arguments: str, compiler: str = 'gcc'
) -> subprocess.CompletedProcess[str]:
    command = [compiler, '-std=c99', '-ffp-contract=off', *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


class InC:
    """An exported controller, with the calls of its twin in Python."""

    def __init__(self, library: CDLL, shape: str) -> None:
        self._state = (c_char * 8192)()
        self._functions = {
            name: getattr(library, f'{shape}_{name}')
            for name in (
                *('init', 'step', 'no_sample', 'enable', 'status', 'mode', 'cause'),
                *('output_estimate', 'disturbance_estimate'),
            )
        }
        for name in ('step', 'no_sample', 'output_estimate', 'disturbance_estimate'):
            self._functions[name].restype = c_double
        self._measured = measured(shape)
        self.command = nan

    def init(self, y: float, u: float) -> None:
        assert self._call('init', c_double(y), c_double(u)) == 0
        self.command = nan

    def step(
        self,
        y: float,
        reference: Sequence[float] | None = None,
        applied: float = nan,
        dt: float = nan,
    ) -> float:
        r = (c_double * len(reference))(*reference) if reference else POINTER(c_double)()
        times = [c_double(dt)] if self._measured else []
        self.command = self._call('step', c_double(y), r, c_double(applied), *times)
        return self.command

    def no_sample(self, dt: float = nan) -> float:
        times = [c_double(dt)] if self._measured else []
        self.command = self._call('no_sample', *times)
        return self.command

    def enable(self, on: bool) -> None:
        self._call('enable', c_bool(on))

    def outcome(self) -> tuple[int, int, int]:
        return self._call('status'), self._call('mode'), self._call('cause')

    def estimates(self) -> tuple[str, str]:
        """Return output and disturbance, to the bit."""
        both = self._call('output_estimate'), self._call('disturbance_estimate')
        return both[0].hex(), both[1].hex()

    def _call(self, name: str, *arguments: Any) -> Any:
        return self._functions[name](byref(self._state), *arguments)


def twin_of(shape: str) -> Twin:
    settings = export_of(shape).settings
    return Twin(settings) if measured(shape) else Twin(settings, exact_period(RATE, False))


def answered(controller: Any, call: Call) -> None:
    """Make a call of a twin, or of what was compiled."""
    dt = call.dt if call.dt > 0.0 else nan
    if call.action == INIT:
        controller.init(call.y, call.applied)
    elif call.action == NO_SAMPLE:
        controller.no_sample(dt)
    elif call.action in (ENABLE, DISABLE):
        controller.enable(call.action == ENABLE)
    else:
        controller.step(call.y, call.reference or None, call.applied, dt)


def told(twin: Twin) -> Outcome:
    controller = twin.controller
    return Outcome(
        controller.command, controller.status.value, controller.mode.value, controller.cause.value
    )
