"""Values that hold from a time on: what live changes of parameters amount to over a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.history import History
from nadrc_ros.report.columns import Array
from nadrc_ros.simulation.plants import PLANTS
import numpy as np
import numpy.typing as npt

T = TypeVar('T')
# What tells the controller and the plant of this package from other nodes.
CONTROLLER = ('structure', 'inner_bandwidth')
PLANT = ('plant', 'noise_variance')
Steps = list[tuple[float, T]]


def controller_settings(history: History) -> Steps[ControllerSettings]:
    """Return the settings of the controller, each with the time [s] from which it held."""
    return _steps(history, CONTROLLER, _settings)


def plant_gain(history: History) -> Steps[float]:
    """
    Return b0 of the simulated plant, from each time [s] on.

    Nothing for a user's plant: a report does not run the code that a record names.
    """
    return _steps(history, PLANT, _plant_b0)


def sampled(steps: Sequence[tuple[float, float]], time: npt.ArrayLike) -> Array:
    """Return what holds at each time [s]; before the first step that one."""
    starts = np.array([start for start, _ in steps])
    values = np.array([value for _, value in steps])
    return np.asarray(values[np.maximum(np.searchsorted(starts, time, 'right') - 1, 0)])


def referred(
    time: npt.ArrayLike,
    command: npt.ArrayLike,
    truth: npt.ArrayLike,
    plant: Sequence[tuple[float, float]],
    controller: Sequence[tuple[float, float]],
) -> Array:
    """
    Return the total disturbance for the b0 of the controller, L = y^(n) - b0 u.

    ``truth`` is the same for the b0 of the plant; ``plant`` and ``controller`` hold both gains
    with the times [s] from which they held.
    """
    gain = sampled(plant, time) - sampled(controller, time)
    return np.asarray(np.asarray(truth) + gain * np.asarray(command))


def _steps(
    history: History, marks: Sequence[str], make: Callable[[Mapping[str, Any]], T | None]
) -> Steps[T]:
    nodes = history.parameters.items()
    having = [(node, values) for node, values in nodes if all(name in values for name in marks)]
    if not having:
        return []
    node, first = having[0]
    values, found = dict(first), [(0.0, make(first))]
    for change in history.changes:
        if change.node == node:
            values[change.name] = change.after
            found.append((change.time, make(values)))
    return [(time, made) for time, made in found if made is not None]


def _settings(values: Mapping[str, Any]) -> ControllerSettings | None:
    return _built(ControllerSettings, values)


def _plant_b0(values: Mapping[str, Any]) -> float | None:
    plant = PLANTS.get(str(values['plant']))
    made = None if plant is None else _built(plant, values)
    return None if made is None else float(made.b0)


def _built(cls: Callable[..., T], values: Mapping[str, Any]) -> T | None:
    """Return the object of the values it has, None where another version means another thing."""
    own = {
        name: tuple(value) if isinstance(value := values[name], list) else value
        for name in declared(cls)  # type: ignore[arg-type]
        if name in values
    }
    try:
        return cls(**own)
    except (UserError, TypeError, ValueError):
        return None
