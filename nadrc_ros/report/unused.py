"""Which parameters of a controller have no effect, as the others are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_WITH_LEVELS = ('nested', 'cascade', 'nonlinear')


def unused(values: Mapping[str, Any]) -> set[str]:
    """Return the names of what is ignored; nothing for what is no controller of this package."""
    try:
        structure, levels = values['structure'], values['levels']
        several = levels > 1 if structure in _WITH_LEVELS else structure == 'printed'
        ignored = {
            'outer_bandwidth': not several,
            'levels': structure not in _WITH_LEVELS,
            'bandwidth_ratio': structure not in _WITH_LEVELS or levels < 3,
            'extended_states': structure != 'generalized',
            'eso_delta': structure != 'nonlinear',
            'fal_gains': values['feedback'] != 'fal',
            'fal_exponents': values['feedback'] != 'fal',
            'fal_delta': values['feedback'] != 'fal',
            'b0_source': len(values['b0_table']) < 2,
            'stall_action': values['stall_time'] == 0.0,
        }
    except (KeyError, TypeError):
        return set()
    return {name for name, off in ignored.items() if off}
