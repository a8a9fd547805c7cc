"""The figures of merit that a table of runs shows, and how."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

ROWS = (
    ('itae', 'ITAE', 'integral of t |e|'),
    ('isu', 'ISU', 'integral of u²'),
    ('iae', 'IAE', 'integral of |e|'),
    ('rmse', 'RMSE', 'root mean square of e'),
    ('max_error', 'max |e|', 'largest error'),
    ('peak_error', 'peak |e|', 'largest error after the settle time'),
    ('max_command', 'max |u|', 'largest command'),
    ('total_variation', 'TV', 'total variation of u'),
    ('saturated_fraction', 'saturated', 'share of the time'),
)


def wins(value: float, values: Sequence[float]) -> bool:
    """Tell whether a figure is the lowest of several that differ."""
    known = [each for each in values if not isnan(each)]
    return bool(known) and value == min(known) < max(known)


def shown(key: str, value: float) -> str:
    """Return a figure as a table shows it."""
    if isnan(value):
        return '-'
    return f'{100.0 * value:.1f} %' if key == 'saturated_fraction' else f'{value:.4g}'
