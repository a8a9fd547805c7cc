"""
The same faults on this package, on pyadrc and on simple-pid: who comes back, and at what price.

    python -m bench.robustness

prints a table and writes out/bench/robustness.json. The plant is a damped chain of two integrators
under a load, which moves by 2 in 4.5 s; the fault begins in mid-motion. An error is the difference
to the same controller's run without the fault, so that nobody is charged for lag or noise.

One LESO of this package and pyadrc are the same law with the same bandwidths and limits.
simple-pid has the gains of the PID controller that this law is (nadrc_ros.theory.pid), but
not its filter, and no rate limit. The actuator is kind to all: it clips a command out of range and
goes on with the last one when sent a number that is none.

Keys of the file: ``settings``, and ``rows`` with ``fault``, ``controller``, ``guarded``,
``recovered``, ``recovery_time`` [s] (null without recovery), ``peak_error``, ``worst_step`` (of
the acting command, in one period) and ``bad_commands`` (sent, not finite or out of range).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from math import isfinite, nan
from pathlib import Path
from typing import Any, Protocol

import attrs
from bench.results import FOLDER
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.atomic import write_json
from nadrc_ros.simulation.faults import Faults, Injector, MeasurementFault
from nadrc_ros.simulation.integrate import Integrator
from nadrc_ros.simulation.noise import Noise, NoiseSource
from nadrc_ros.simulation.plants import Chain
from nadrc_ros.simulation.protocols import MutableVector
from nadrc_ros.simulation.signals import Trapezoid
from nadrc_ros.theory.pid import equivalent_pid
import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

FILE = FOLDER / 'robustness.json'
SEED = 1
PERIOD = 0.01
FAULT = 3.0
BAND = 0.05
RECOVERY = 10.0
STAY = 1.0
LIMIT = 10.0
RATE_LIMIT = 200.0
BANDWIDTH = 4.0
OBSERVER = 40.0
PLANT = Chain(order=2, damping=1.0, load=2.0)
REFERENCE = Trapezoid(amplitude=2.0, velocity=0.5, acceleration=1.0, start_time=1.0)
NOISE_VARIANCE = 1e-8  # so little that the steps of the command are those of the fault
SETTINGS = ControllerSettings(
    structure='conventional',
    inner_bandwidth=OBSERVER,
    controller_bandwidth=BANDWIDTH,
    reference_derivatives='none',  # the others take none
    command_min=-LIMIT,
    command_max=LIMIT,
    command_rate_limit=RATE_LIMIT,
)


@attrs.frozen(kw_only=True)
class Case:
    """What goes wrong for ``duration`` [s] from ``FAULT`` on; ``b0`` stays changed."""

    duration: float = PERIOD
    kind: str = 'none'
    size: float = 1.0
    probability: float = 1.0
    load: float = 0.0
    jitter: float = 0.0
    b0: float = 1.0

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write the additional load as the disturbance of the plant."""
        out[0] = -self.load if FAULT <= t < FAULT + self.duration else 0.0

    def periods(self, seed: int) -> list[float]:
        """Return the times from tick to tick [s]."""
        rng = np.random.default_rng(seed)
        count = round((FAULT + self.duration + RECOVERY + STAY) / PERIOD)
        periods = np.full(count, PERIOD)
        hit = slice(round(FAULT / PERIOD), round((FAULT + self.duration) / PERIOD))
        periods[hit] *= 1.0 + rng.uniform(-self.jitter, self.jitter, len(periods[hit]))
        return [float(h) for h in periods]

    def injector(self, seed: int) -> Injector:
        fault = MeasurementFault(
            kind=self.kind,
            size=self.size,
            probability=self.probability,
            start=FAULT,
            duration=self.duration,
        )
        return Injector(Faults(measurement=(fault,)), 1.0 / PERIOD, seed)


NO_FAULT = Case(duration=10.0)
CASES = {
    'none': NO_FAULT,
    'one NaN': Case(kind='not_a_number'),
    '1 s of NaN': Case(kind='not_a_number', duration=1.0),
    '5 % of ticks dropped, 5 s': Case(kind='intermittent', probability=0.05, duration=5.0),
    '10 s of saturation': Case(load=9.0, duration=10.0),
    'b0 from 1 to 2': Case(b0=2.0),
    'sensor stuck for 1 s': Case(kind='stuck', duration=1.0),
    'tick jitter +-30 %, 5 s': Case(jitter=0.3, duration=5.0),
    'one spike of 1000': Case(kind='spike', size=1e3),
}


class Contestant(Protocol):
    """A controller in its loop."""

    def tick(self, r: float, y: float | None, elapsed: float, applied: float) -> float:
        """Return the command; ``y`` is None when no sample came, ``elapsed`` since last tick."""
        ...

    def change_b0(self, b0: float) -> None:
        """Go on with another b0."""
        ...


class Ours:
    """The controller of this package, as the node calls it: each period, whatever came."""

    def __init__(self, **changes: Any) -> None:
        self.settings = attrs.evolve(SETTINGS, **changes)
        # The rivals begin with their first sample, too.
        self.controller = Controller(self.settings, checked=True)
        self.span = 0.0

    def tick(self, r: float, y: float | None, elapsed: float, applied: float) -> float:
        self.span += elapsed
        dt = 0.0 if y is None else self.span
        self.span -= dt
        return self.controller.tick(
            nan if y is None else y, dt, elapsed=elapsed, reference=[r], applied=applied
        )

    def change_b0(self, b0: float) -> None:
        self.controller.retune(attrs.evolve(self.settings, b0=b0))


class Rival(ABC):
    """A law that is called when there is a sample, and if ``guarded`` only when it is finite."""

    def __init__(self, guarded: bool) -> None:
        self.guarded = guarded
        self.span = 0.0

    def tick(self, r: float, y: float | None, elapsed: float, applied: float) -> float:
        self.span += elapsed
        if y is None or (self.guarded and not isfinite(y)):
            return applied
        dt, self.span = self.span, 0.0
        return self.law(r, y, dt, applied)

    @abstractmethod
    def law(self, r: float, y: float, dt: float, applied: float) -> float:
        """Return the command for a sample that came ``dt`` after the one before [s]."""


class PyAdrc(Rival):
    """pyadrc's state-space form, of a fixed step: it cannot be told how much time went by."""

    def __init__(self, guarded: bool) -> None:
        super().__init__(guarded)
        self.adrc = self._make(1.0, (0.0, 0.0, 0.0))

    def law(self, r: float, y: float, dt: float, applied: float) -> float:
        return float(self.adrc(y, applied, r))

    def change_b0(self, b0: float) -> None:
        # Assigning `adrc.b0` changes the gain of r alone, the feedback and the observer keep the
        # old b0: y then goes to r / 2. So a user makes a new one and hands over what it allows:
        # the estimates and the last command.
        before = self.adrc
        self.adrc = self._make(b0, before.eso_states.ravel())
        self.adrc.ukm1 = before.ukm1

    def _make(self, b0: float, estimates: Iterable[float]) -> Any:
        from pyadrc import StateSpace

        step = RATE_LIMIT * PERIOD
        return StateSpace(
            order=2,
            delta=PERIOD,
            b0=b0,
            w_cl=BANDWIDTH,
            k_eso=OBSERVER / BANDWIDTH,
            eso_init=tuple(estimates),
            m_lim=(-LIMIT, LIMIT),
            r_lim=(-step, step),
        )


class SimplePid(Rival):
    """simple-pid, told the time that went by."""

    def __init__(self, guarded: bool) -> None:
        from simple_pid import PID

        super().__init__(guarded)
        gains = equivalent_pid(make_design(SETTINGS))
        self.gains = gains.kp, gains.ki, gains.kd
        self.pid = PID(*self.gains, sample_time=None, output_limits=(-LIMIT, LIMIT))

    def law(self, r: float, y: float, dt: float, applied: float) -> float:
        self.pid.setpoint = r
        return float(self.pid(y, dt=dt))

    def change_b0(self, b0: float) -> None:
        # It has no b0; each gain is inversely proportional to it.
        self.pid.tunings = tuple(gain / b0 for gain in self.gains)


Make = Callable[[], Contestant]
OURS: dict[tuple[str, bool], Make] = {
    ('nadrc, nested', False): lambda: Ours(structure='nested'),
    ('nadrc, one LESO', False): Ours,
}
RIVALS: dict[tuple[str, bool], Make] = {
    ('pyadrc', False): lambda: PyAdrc(False),
    ('pyadrc', True): lambda: PyAdrc(True),
    ('simple-pid', False): lambda: SimplePid(False),
    ('simple-pid', True): lambda: SimplePid(True),
}


@attrs.frozen
class Run:
    """Times [s], outputs and commands that acted, shape (N,); how many bad commands were sent."""

    time: npt.NDArray[np.float64]
    output: npt.NDArray[np.float64]
    command: npt.NDArray[np.float64]
    bad_commands: int


@attrs.frozen
class Row:
    """What a fault did to a controller; the keys are described at the top."""

    fault: str
    controller: str
    guarded: bool
    recovered: bool
    recovery_time: float | None
    peak_error: float
    worst_step: float
    bad_commands: int


def run(contestant: Contestant, case: Case, seed: int) -> Run:
    """Run the loop: at t_k measure, decide, hold."""
    periods, injector = case.periods(seed), case.injector(seed)
    noise = NoiseSource(Noise(variance=NOISE_VARIANCE, seed=seed), PERIOD)
    integrator = Integrator(PLANT, case)
    x, following = [0.0, 0.0], [0.0, 0.0]
    reference, rows, bad = [0.0], [], 0
    t, elapsed, applied = 0.0, PERIOD, 0.0
    for k, h in enumerate(periods):
        y = PLANT.output(x)
        REFERENCE.derivatives(t, reference)
        if case.b0 != 1.0 and k == round(FAULT / PERIOD):
            contestant.change_b0(case.b0)
        samples = injector.deliver(k, y + noise.at(k))
        sample = samples[-1].value if samples else None
        sent = contestant.tick(reference[0], sample, elapsed, applied)
        bad += not -LIMIT <= sent <= LIMIT
        if isfinite(sent):
            applied = min(max(sent, -LIMIT), LIMIT)
        rows.append((t, y, applied))
        integrator.advance(t, x, applied, h, following)
        x, following = following, x
        t, elapsed = t + h, h
    time, output, command = np.array(rows).T
    return Run(time, output, command, bad)


def judge(name: tuple[str, bool], fault: str, case: Case, faulty: Run, healthy: Run) -> Row:
    """Compare a run with the one without the fault."""
    after = faulty.time > FAULT - 0.5 * PERIOD
    error = np.abs(faulty.output - np.interp(faulty.time, healthy.time, healthy.output))
    away = faulty.time[after & (error > BAND)]
    end = FAULT + case.duration
    recovery = max(float(away[-1]) + PERIOD - end, 0.0) if len(away) else 0.0
    recovered = recovery < RECOVERY  # and stays in the band for at least STAY
    steps = np.abs(np.diff(faulty.command))[after[1:]]
    return Row(
        fault,
        *name,
        recovered,
        recovery if recovered else None,
        float(error[after].max()),
        float(steps.max()),
        faulty.bad_commands,
    )


def measure(contestants: dict[tuple[str, bool], Make], seed: int) -> list[Row]:
    """Return a row for each fault and controller."""
    healthy = {name: run(make(), NO_FAULT, seed) for name, make in contestants.items()}
    return [
        judge(name, fault, case, run(make(), case, seed), healthy[name])
        for fault, case in CASES.items()
        for name, make in contestants.items()
    ]


def write(rows: list[Row], seed: int, path: Path) -> None:
    settings = {
        'seed': seed,
        'period': PERIOD,
        'band': BAND,
        'recovery_limit': RECOVERY,
        'command_limit': LIMIT,
        'command_rate_limit': RATE_LIMIT,
        'controller_bandwidth': BANDWIDTH,
        'observer_bandwidth': OBSERVER,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {'settings': settings, 'rows': [attrs.asdict(row) for row in rows]}
    write_json(path, 'robustness', document)


def show(rows: list[Row]) -> None:
    table = Table(box=None, pad_edge=False)
    for column in ('fault', 'controller'):
        table.add_column(column, no_wrap=True)
    for column in ('recovered after', 'peak error', 'worst step of u', 'bad commands'):
        table.add_column(column, justify='right')
    fault = ''
    for before, row in zip([None, *rows], rows):
        if before and attrs.evolve(before, guarded=True) == row:
            continue
        if fault not in ('', row.fault):
            table.add_row()
        table.add_row(
            row.fault if row.fault != fault else '',
            row.controller + (', guarded' if row.guarded else ''),
            'NEVER' if row.recovery_time is None else f'{row.recovery_time:.2f} s',
            f'{row.peak_error:.3f}',
            f'{row.worst_step:.2f}',
            str(row.bad_commands),
        )
        fault = row.fault
    console = Console(width=100)
    console.print(table)
    console.print(FOOTNOTE, highlight=False)


FOOTNOTE = (
    "\nError: the difference to the same controller's run without a fault. Recovered: within "
    f'{BAND:g} for good, counted from the end of the fault; NEVER: not within {RECOVERY:g} s. '
    'Worst step: of the command that acts, in one period. Bad commands: sent, not finite or '
    f'outside +-{LIMIT:g}. Guarded: with one line around it, the law is called for finite '
    'measurements only and the last command held otherwise; left out where that changes nothing. '
    'In 1 s of NaN, nadrc holds the command for '
    f'{SETTINGS.measurement_timeout + SETTINGS.hold_time:g} s and then goes to its safe command, '
    '0: away from the reference, on purpose.'
)


def main() -> None:
    rows = measure(OURS | RIVALS, SEED)
    write(rows, SEED, FILE)
    show(rows)


if __name__ == '__main__':
    main()
