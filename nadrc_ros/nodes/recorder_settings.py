"""What a recorder node records, and where to: its parameters."""

from __future__ import annotations

from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, Declared, declared, integer, number, text
from nadrc_ros.adrc.settings import LONGEST
from nadrc_ros.records.recording import ESTIMATES, FigureSettings, NEEDED, topic_of, TRUTH
from nadrc_ros.ros.signal_parameters import behind, without
from nadrc_ros.scenario.units import Units

_UNITS = 'units.'
DEFAULT_INPUTS = (*NEEDED, *TRUTH, *ESTIMATES, 'level_1', 'level_2')


@attrs.frozen(kw_only=True)
class RecorderSettings(FigureSettings):
    """What is recorded, and where to."""

    inputs: str = text(
        ' '.join(DEFAULT_INPUTS),
        'signals to record, separated by spaces: these, applied, feed_forward, level_3 ...',
        live=False,
    )
    plant: str = text('plant', 'name of the plant node, for its ~/output', live=False)
    controller: str = text('controller', 'name of the controller node', live=False)
    directory: str = text('runs', 'where a new folder is made for each run', live=False)
    duration: float = number(
        0.0,
        0.0,
        LONGEST,
        's',
        'length of a run, from the first command; 0 = until stopped',
        live=False,
    )
    color: int = integer(
        -1,
        -1,
        17,
        'number of the color of its lines in reports; -1 = as many as there are runs before it',
        live=False,
    )

    def topics(self) -> dict[str, str]:
        """
        Return the topic of each input, in the order of the columns.

        Raises
        ------
        SettingError
            For an input that does not exist, or one of the three needed ones left out.

        """
        names = self.inputs.split()
        for name in NEEDED:
            if name not in names:
                raise SettingError('inputs', self.inputs, f'a list that has {name}')
        return {name: topic_of(name, self.plant, self.controller) for name in names}


def unit_fields() -> dict[str, Declared]:
    """Return the parameters of the units."""
    return behind(_UNITS, declared(Units))


def make_units(values: dict[str, Any]) -> Units:
    """Return the units that the parameters say."""
    return build(Units, without(_UNITS, values), _UNITS[:-1])
