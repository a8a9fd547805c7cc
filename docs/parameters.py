"""Writes docs/parameters.md, the parameters of every node, from their declarations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nadrc_ros.adrc import ControllerSettings
from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.nodes.loop_settings import LoopSettings
from nadrc_ros.nodes.plant_settings import fault_fields, noise_fields, PlantSettings
from nadrc_ros.nodes.recorder_settings import RecorderSettings, unit_fields
from nadrc_ros.nodes.reference import ReferenceSettings
from nadrc_ros.ros.pacing import PacingSettings
from nadrc_ros.ros.signal_parameters import DISTURBANCE, NOISE_SIGNAL, REFERENCE
from nadrc_ros.ros.wiring_parameters import wiring_fields
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.sensor import Sensor

PAGE = Path(__file__).with_name('parameters.md')
INTRODUCTION = """# Parameters

Here you look up every parameter of every node. The page is made from the code by
`python docs/parameters.py`. Those that are live can be
changed while a node runs, the others are fixed at start. A value outside its range is refused with
a reason.
"""


def page() -> str:
    """Return the whole page."""
    tables: dict[str, Mapping[str, Declared]] = {
        'All nodes': declared(PacingSettings),
        'controller': declared(LoopSettings) | declared(ControllerSettings),
        'controller, signals that are fields of messages': wiring_fields(),
        'plant': (
            declared(PlantSettings)
            | noise_fields()
            | NOISE_SIGNAL.fields()
            | DISTURBANCE.fields()
            | declared(Sensor)
            | fault_fields()
        ),
        **{f'plant, with `plant: {name}`': declared(cls) for name, cls in PLANTS.items()},
        'reference': REFERENCE.fields() | declared(ReferenceSettings),
        'reference, with `signal: my_log.csv`; `disturbance_`, `noise_signal_` for the plant': (
            REFERENCE.fields('my_log.csv')
        ),
        'recorder': declared(RecorderSettings) | unit_fields(),
    }
    parts = [INTRODUCTION]
    parts += [f'## {title}\n\n{table(fields)}' for title, fields in tables.items()]
    return '\n'.join(parts)


def table(fields: Mapping[str, Declared]) -> str:
    """Return one table of parameters."""
    rows = ['| name | default | unit | allowed | live | meaning |', '|---|---|---|---|---|---|']
    for name, field in fields.items():
        cells = (
            f'`{name}`',
            f'`{shown(field.default)}`',
            field.unit,
            field.allowed(),
            'yes' if field.live else 'no',
            field.description,
        )
        rows.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(rows) + '\n'


def shown(value: Any) -> str:
    """Return a default as a parameter file would have it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and abs(value) >= 1e6:
        return f'{value:.1e}'
    return str(list(value)) if isinstance(value, tuple) else repr(value)


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
