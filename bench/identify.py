"""
How often the 95 % interval of `nadrc identify` holds the true b0, over many noises.

    python -m bench.identify

Four plants of the package in closed loop, each with noise and a disturbance, written as the
recorder writes and read as the command reads: the paper's (26) with a gain that varies by 20 %, a
chain of order 3 with damping, a motor whose current lags and whose load steps, and a pendulum
that goes upright and is pushed. Then the plants of :mod:`bench.other_plants`. Each log is tried
with the order given and with the order open. An order that is not the plant's counts as an
interval that does not hold the truth.

One rule says what is true of all: the b0 of order n is the factor of u in
tau y^(n+1) + y^(n) = b0 u + ..., with a lag tau or without. A plant of the package declares it.

Keys: ``identify.<plant>.given_answers`` logs that were not refused, ``.given_held`` intervals
that hold the truth, ``.given_width`` median of the half intervals over their estimates [%],
``.given_widest`` the largest, ``.given_bias`` mean of the estimates over the truth minus 1 [%],
``.given_scatter`` their standard deviation over the truth [%]; ``.open_...`` the same with the
order open. Samples: seed, estimate, standard error and order of each answer.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from math import nan
from multiprocessing import get_context
import os
from pathlib import Path
import re
from tempfile import TemporaryDirectory
from typing import Any

import attrs
from bench.logs import Case
from bench.other_plants import CASES
from bench.results import save, show
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.records.recording import RunFolder, RunSettings
from nadrc_ros.scenario import find_scenario, load, Scenario
from nadrc_ros.scenario.files import loads
from nadrc_ros.tuning.identification.estimate import Z95
from nadrc_ros.tuning.identification.identify import identify
from nadrc_ros.tuning.identification.log import log_of
import numpy as np

SEEDS = 12
ORDERS = ('given', 'open')
COLUMNS = ('time', 'reference', 'measurement', 'command', 'output')
PAPER = """
plant: {name: paper, a3: 0.2}
reference: {signal: chirp, frequency: 1, end_frequency: 2, sweep_time: 60}
disturbance: {signal: sine, frequency: 0.7}
noise: {variance: 1e-6}
rate: 100
duration: 60
limits: {command_min: -30, command_max: 30}
controllers: {nested: {inner_bandwidth: 20, outer_bandwidth: 20, controller_bandwidth: 4}}
"""
CHAIN = """
plant: {name: chain, order: 3, gain: 2, damping: 0.5}
reference: {signal: chirp, frequency: 0.3, end_frequency: 3, sweep_time: 30}
disturbance: {signal: sine, amplitude: 2, frequency: 0.7}
noise: {variance: 1e-8}
rate: 100
duration: 30
limits: {command_min: -40, command_max: 40}
controllers: {nested: {inner_bandwidth: 20, outer_bandwidth: 10, controller_bandwidth: 3}}
"""
MOTOR = """
plant: {name: motor}
reference: {signal: square, offset: 100, amplitude: 50, frequency: 6}
disturbance: {signal: step, amplitude: -2500, start_time: 2}
noise: {variance: 0.01}
rate: 1000
duration: 4
limits: {command_min: -24, command_max: 24}
controllers: {nested: {inner_bandwidth: 150, outer_bandwidth: 60, controller_bandwidth: 40}}
"""
# The shipped pendulum, kept under the controller with which the published figures were measured.
PENDULUM = load(find_scenario('pendulum'))
NESTED = attrs.evolve(
    PENDULUM.controllers['nested'],
    inner_bandwidth=25.0,
    outer_bandwidth=20.0,
    controller_bandwidth=5.0,
    feedback_level='inner',
)


@attrs.frozen
class Shipped:
    """An experiment with a plant of the package, whose b0 is the one that it declares."""

    scenario: Scenario

    @property
    def order(self) -> int:
        """Return the order by which the plant is known."""
        return self.scenario.plant.make().order

    @property
    def b0(self) -> dict[int, float]:
        """Return the true gain by the order that is true."""
        plant: Any = self.scenario.plant.make()
        return {plant.order: plant.b0}

    def log(self, seed: int) -> RecordedRun:
        """Return what the recorder would have written."""
        with TemporaryDirectory() as directory:
            return read_run(record(self.scenario.changed(seed=seed), Path(directory)))


def record(scenario: Scenario, directory: Path) -> Path:
    """Run the last controller of a scenario; return the folder that a recorder would have made."""
    result = scenario.run(list(scenario.controllers)[-1])
    folder = RunFolder(directory, COLUMNS, RunSettings(rate=scenario.rate))
    for row in zip(*(getattr(result, name).tolist() for name in COLUMNS)):
        folder.write(row)
    folder.close()
    return folder.path


PLANTS: dict[str, Shipped | Case] = {
    'paper': Shipped(loads(PAPER)),
    'chain': Shipped(loads(CHAIN)),
    'motor': Shipped(loads(MOTOR)),
    'pendulum': Shipped(attrs.evolve(PENDULUM, controllers={'nested': NESTED})),
    **CASES,
}


@attrs.frozen(kw_only=True)
class Answer:
    """What is found of one log: b0, whether its interval holds the truth, or why nothing is."""

    seed: int
    b0: float = nan
    error: float = nan
    order: int = 0
    held: bool = False
    refusal: str = ''


def answer(plant: Shipped | Case, seed: int, order: str) -> Answer:
    """Return what is found of the log of one seed, with the order 'given' or 'open'."""
    try:
        found = identify(log_of(plant.log(seed)), plant.order if order == 'given' else None)
    except UserError as refusal:
        return Answer(seed=seed, refusal=str(refusal))
    held = found.b0.low <= plant.b0.get(found.order, nan) <= found.b0.high
    return Answer(seed=seed, b0=found.b0.value, error=found.b0.error, order=found.order, held=held)


def figures(plant: Shipped | Case, answers: Sequence[Answer]) -> dict[str, float]:
    """Return the figures of one plant, its order given or open."""
    given = [each for each in answers if not each.refusal]
    right = [each for each in given if each.order in plant.b0]
    widths = [100.0 * Z95 * each.error / abs(each.b0) for each in given] or [nan]
    errors = [100.0 * (each.b0 / plant.b0[each.order] - 1.0) for each in right] or [nan]
    return {
        'answers': len(given),
        'held': sum(each.held for each in given),
        'width': float(np.median(widths)),
        'widest': max(widths),
        'bias': float(np.mean(errors)),
        'scatter': float(np.std(errors)),
    }


def _named(task: tuple[str, int, str]) -> Answer:
    name, seed, order = task
    return answer(PLANTS[name], seed, order)


def study(names: Iterable[str], seeds: int = SEEDS) -> dict[tuple[str, str], list[Answer]]:
    """Return the answers of all seeds by plant and order, from as many processes as there are."""
    parts = [(name, order) for name in names for order in ORDERS]
    tasks = [(name, seed, order) for name, order in parts for seed in range(seeds)]
    with ProcessPoolExecutor(mp_context=get_context('spawn')) as executor:
        answers = executor.map(_named, tasks)
        return {part: [next(answers) for _ in range(seeds)] for part in parts}


def refusals(answers: Sequence[Answer]) -> str:
    """Return how often which reason was given, without its numbers."""
    reasons = Counter(
        re.sub(r'[-+]?\d[\d.e+-]*', '..', each.refusal) for each in answers if each.refusal
    )
    return '; '.join(f'{count} x {reason}' for reason, count in reasons.items())


def main(names: Iterable[str] = PLANTS, seeds: int = SEEDS, **where: Any) -> None:
    """Try all plants and print a row for each."""
    # A process for each core has no use for threads of linear algebra, which wait for each other.
    os.environ |= {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
    found = study(names, seeds)
    samples = {
        f'{name}, {order}': [(a.seed, a.b0, a.error, a.order) for a in answers]
        for (name, order), answers in found.items()
    }
    rows: dict[str, dict[str, float]] = {}
    for (name, order), answers in found.items():
        own = figures(PLANTS[name], answers).items()
        rows.setdefault(name, {}).update({f'{order}_{key}': value for key, value in own})
    for order in ORDERS:
        table = {
            name: {key: row[f'{order}_{key}'] for key in ('answers', 'held', 'width', 'bias')}
            for name, row in rows.items()
        }
        held, total = (
            int(sum(row[f'{order}_{key}'] for row in rows.values())) for key in ('held', 'answers')
        )
        show(
            f'identify, the order {order}',
            table,
            f'{held} of {total} intervals hold the truth ({100.0 * held / max(total, 1):.1f} %); '
            f'{seeds} seeds each; median half width and bias in % of b0',
        )
        for name in rows:
            if said := refusals(found[name, order]):
                print(f'{name}: refused {said}')
        print()
    save('identify', rows, samples, **where)


if __name__ == '__main__':
    main()
