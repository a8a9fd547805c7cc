"""The columns of one run that a picture needs, wherever they were recorded."""

from __future__ import annotations

from typing import Any

import attrs
from nadrc_ros.simulation.simulate import Result
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def _array(values: Any) -> Array:
    return np.asarray(values, dtype=np.float64)


@attrs.frozen(kw_only=True, eq=False)
class Trace:
    """
    One controller's run: arrays (N,), not-a-number where nothing was recorded.

    ``total_disturbance`` is the truth, ``disturbance_estimate`` the sum of the levels.
    """

    time: Array = attrs.field(converter=_array)
    reference: Array = attrs.field(converter=_array)
    output: Array = attrs.field(converter=_array)
    command: Array = attrs.field(converter=_array)
    disturbance_estimate: Array = attrs.field(converter=_array)
    total_disturbance: Array = attrs.field(converter=_array)

    def __attrs_post_init__(self) -> None:
        columns = attrs.asdict(self, recurse=False)
        for name, values in columns.items():
            if values.shape != (len(self.time),):
                raise ValueError(f'{name} has shape {values.shape}, time {self.time.shape}')

    @property
    def error(self) -> Array:
        """Return the tracking error r - y."""
        return self.reference - self.output

    @property
    def unrest(self) -> float:
        """Return the total variation of the command, where it is known."""
        return float(np.nansum(np.abs(np.diff(self.command))))


def trace_of(result: Result) -> Trace:
    """Return the trace of an offline run."""
    return Trace(
        time=result.time,
        reference=result.reference,
        output=result.output,
        command=result.command,
        disturbance_estimate=result.disturbance_estimate,
        total_disturbance=result.total_disturbance,
    )
