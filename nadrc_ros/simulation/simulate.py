"""The closed loop run offline, with the law that the node runs."""

from __future__ import annotations

from collections.abc import Callable

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.loop import (
    COLUMNS,
    FIRST_LEVEL,
    INNER_COLUMNS,
    Kernel,
    Loop,
    ROW_WIDTH,
    row_width,
)
from nadrc_ros.simulation.metrics import MetricValues
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# Plain Python takes some 10 s for that many periods, numba about as long to compile.
WORTH_COMPILING = 200_000
# Rows of that many periods take 6 GB; :func:`~nadrc_ros.simulation.batch.run_metrics` keeps none.
_MOST_ROWS = 50_000_000


@attrs.frozen(kw_only=True, eq=False)
class InnerLoop:
    """
    An inner loop of a run: arrays (N,) over the periods.

    Its ``reference`` is the command of the loop around it, its ``output`` a derivative of that of
    the plant.
    """

    reference: Array
    output: Array
    measurement: Array


@attrs.frozen(kw_only=True, eq=False)
class Result:
    """
    One run: arrays (N,) over the periods, ``disturbances`` (N, K) one column per level.

    Row k: reference, output and measurement at ``time`` t_k, the ``command`` held from t_k on, and
    the estimates after the sample of t_k. ``total_disturbance`` is the truth for the CONTROLLER's
    b0. A level that was added by a retune is nan before. ``modes`` are what the controller did and
    why, each with the time [s] from which on.

    Of a cascade, ``tracking`` and ``output_estimate`` are of the outermost loop, the disturbances
    and ``status_counts`` of the innermost one, and ``inner`` has the loops inside the outermost.
    """

    time: Array
    reference: Array
    tracking: Array
    output: Array
    measurement: Array
    command: Array
    output_estimate: Array
    disturbances: Array
    disturbance_estimate: Array
    total_disturbance: Array
    metrics: MetricValues
    status_counts: dict[str, int]
    modes: tuple[tuple[float, Mode, Cause], ...] = ()
    measurement_period: float = 0.0
    inner: tuple[InnerLoop, ...] = ()


def simulate(
    experiment: Experiment,
    settings: ControllerSettings,
    *,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
) -> Result:
    """
    Run the closed loop offline: at each t_k measure, decide, hold the command until t_k+1.

    Parameters
    ----------
    experiment, settings
        What is done to which controller.
    compiled
        Whether to compile the loop, which gives the same bits. By default a run that is long
        enough to win by it is compiled. Without numba, or with a plant or signal that does not
        compile, the loop runs in plain Python all the same.
    say
        Called with one line before numba compiles, which takes some seconds, once per machine
        for each combination of plant and signal classes.

    Raises
    ------
    SettingError
        For a run of so many periods that their rows do not fit in memory.

    """
    steps = experiment.steps
    if steps > _MOST_ROWS:
        raise SettingError(
            'duration',
            experiment.duration,
            f'at most {_MOST_ROWS / experiment.rate:g} s, '
            f'{_MOST_ROWS:,} periods, to keep every one',
        )
    loop, rows = Loop(experiment, settings), np.full((steps, row_width(settings)), np.nan)
    loop.run(rows, kernel_of(experiment, steps, compiled, say))
    columns = dict(zip(COLUMNS, np.ascontiguousarray(rows.T)))
    width = len(INNER_COLUMNS)
    parts = [rows[:, i : i + width].T.copy() for i in range(ROW_WIDTH, rows.shape[1], width)]
    return Result(
        **columns,
        inner=tuple(InnerLoop(**dict(zip(INNER_COLUMNS, part))) for part in parts),
        disturbances=rows[:, FIRST_LEVEL : FIRST_LEVEL + loop.levels].copy(),
        metrics=loop.metrics.values(),
        status_counts={s.name.lower(): n for s, n in loop.controller.counts.items() if n},
        modes=tuple(loop.modes),
        measurement_period=settings.measurement_period,
    )


def kernel_of(
    experiment: Experiment,
    periods: int,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
) -> Kernel | None:
    """
    Return the compiled loop for the classes in ``experiment``, None for plain Python.

    ``periods`` is how many are about to be run: with ``compiled`` None it decides.
    """
    if compiled is False or (compiled is None and periods < WORTH_COMPILING):
        return None
    try:
        from nadrc_ros.simulation.kernel import kernel_for
    except ImportError:
        return None
    return kernel_for(experiment, say)
