"""
How often the 95 % interval of `nadrc identify` holds the true b0, over many noises.

    python -m bench.identify

Four plants in closed loop, each with noise and a disturbance, simulated with 100 seeds, written
as the recorder writes and read as the command reads: the paper's (26) with a gain that varies by
20 %, a chain of order 3 with damping, a motor whose current lags and whose load steps, and a
pendulum that goes upright and is pushed. The order is given, but for the first seeds: there it is
found, too. Then the plants of :mod:`bench.other_plants` with 12 seeds, with the order open and
with it given. An order that is not the plant's counts as an interval that does not hold the truth.

Keys: ``identify.<plant>.covered`` share of intervals that hold the truth, ``.width`` the widest
half interval over its estimate, ``.bias`` mean of the estimates over the truth minus 1,
``.scatter`` their standard deviation over the truth, ``.order`` share of orders found right;
``identify_others.<plant>.open_held`` and ``.given_held`` intervals that hold the truth,
``.open``, ``.given`` answers, ``.width`` half the seeds have a narrower half interval.
Samples: estimate, standard error and order of each seed, by plant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
import re
from tempfile import TemporaryDirectory
from typing import Any

import attrs
from bench.other_plants import CASES
from bench.results import save, show
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recording import RunFolder, RunSettings
from nadrc_ros.scenario import find_scenario, load, Scenario
from nadrc_ros.scenario.files import loads
from nadrc_ros.tuning.identification.identify import identify
from nadrc_ros.tuning.identification.log import log_of
import numpy as np

SEEDS, ORDER_SEEDS, OTHER_SEEDS = 100, 10, 12
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
Found = tuple[float, float, int]


def scenarios() -> dict[str, Scenario]:
    texts = {'paper': PAPER, 'chain': CHAIN, 'motor': MOTOR}
    return {
        **{name: loads(text) for name, text in texts.items()},
        'pendulum': attrs.evolve(PENDULUM, controllers={'nested': NESTED}),
    }


def record(scenario: Scenario, directory: Path) -> Path:
    """Run the last controller of a scenario; return the folder that a recorder would have made."""
    result = scenario.run(list(scenario.controllers)[-1])
    folder = RunFolder(directory, COLUMNS, RunSettings(rate=scenario.rate))
    for row in zip(*(getattr(result, name).tolist() for name in COLUMNS)):
        folder.write(row)
    folder.close()
    return folder.path


def estimate(task: tuple[Scenario, int, bool]) -> Found:
    scenario, seed, blind = task
    order = None if blind else scenario.plant.make().order
    with TemporaryDirectory() as directory:
        run = read_run(record(scenario.changed(seed=seed), Path(directory)))
    try:
        plant = identify(log_of(run), order)
    except UserError:
        return float('nan'), float('nan'), 0
    return plant.b0.value, plant.b0.error, plant.order


def figures(scenario: Scenario, found: list[Found], blind: int) -> dict[str, float]:
    plant: Any = scenario.plant.make()
    intervals = [(b0, 1.959964 * error) for b0, error, _ in found]
    errors = [b0 / plant.b0 - 1.0 for b0, _ in intervals]
    bias = sum(errors) / len(errors)
    return {
        'covered': sum(abs(b0 - plant.b0) <= half for b0, half in intervals) / len(found),
        'width': max(half / abs(b0) for b0, half in intervals),
        'bias': bias,
        'scatter': (sum((e - bias) ** 2 for e in errors) / len(errors)) ** 0.5,
        'order': sum(order == plant.order for _, _, order in found[:blind]) / blind,
    }


def study(
    cases: Mapping[str, Scenario], seeds: int = SEEDS, blind: int = ORDER_SEEDS
) -> tuple[dict[str, dict[str, float]], dict[str, list[Found]]]:
    """Return the figures of each plant, and the estimates of each seed."""
    samples: dict[str, list[Found]] = {}
    with ProcessPoolExecutor() as executor:
        for name, scenario in cases.items():
            tasks = [(scenario, seed, seed < blind) for seed in range(seeds)]
            samples[name] = list(executor.map(estimate, tasks))
    return {name: figures(cases[name], found, blind) for name, found in samples.items()}, samples


def try_other(task: tuple[str, int, bool]) -> Found | str:
    """Return what is found of a plant that is not the package's, or why nothing is."""
    name, seed, blind = task
    try:
        plant = identify(log_of(CASES[name].log(seed)), None if blind else CASES[name].order)
    except UserError as refusal:
        return str(refusal)
    return plant.b0.value, plant.b0.error, plant.order


def holds(name: str, found: Found) -> bool:
    b0, error, order = found
    return abs(b0 - CASES[name].b0.get(order, float('nan'))) <= 1.959964 * error


def study_others(
    names: Iterable[str], seeds: int = OTHER_SEEDS
) -> tuple[dict[str, dict[str, float]], dict[str, list[Found]], dict[str, list[str]]]:
    """Return figures and estimates by plant, and the reasons of refusals."""
    rows: dict[str, dict[str, float]] = {}
    samples: dict[str, list[Found]] = {}
    reasons: dict[str, list[str]] = {}
    with ProcessPoolExecutor() as executor:
        for name in names:
            row, half = {}, []
            for kind in ('open', 'given'):
                tasks = [(name, seed, kind == 'open') for seed in range(seeds)]
                found = list(executor.map(try_other, tasks))
                answers = [f for f in found if not isinstance(f, str)]
                row[f'{kind}_held'] = float(sum(holds(name, f) for f in answers))
                row[kind] = float(len(answers))
                half += [1.959964 * error / abs(b0) for b0, error, _ in answers]
                samples[f'{name}, {kind}'] = answers
                reasons.setdefault(name, []).extend(f for f in found if isinstance(f, str))
            rows[name] = row | {'width': float(np.median(half)) if half else float('nan')}
    return rows, samples, reasons


def main(seeds: int = SEEDS, other_seeds: int = OTHER_SEEDS, **where: Any) -> None:
    found, samples = study(scenarios(), seeds)
    save('identify', found, samples, **where)
    show('identify', found, f'{seeds} seeds; width and bias relative to b0')
    rows, others, reasons = study_others(CASES, other_seeds)
    save('identify_others', rows, others, **where)
    total = {key: sum(row[key] for row in rows.values()) for key in next(iter(rows.values()))}
    share = [total[f'{kind}_held'] / total[kind] for kind in ('open', 'given')]
    show(
        'identify, plants it was not built on',
        rows,
        f'{other_seeds} seeds; held {100 * share[0]:.1f} % with the order open, '
        f'{100 * share[1]:.1f} % with it given',
    )
    for name, said in reasons.items():
        for reason in sorted({re.sub(r'[-+]?\d[\d.e+-]*', '..', text) for text in said}):
            print(f'{name}: refused {len(said)} times: {reason}')


if __name__ == '__main__':
    main()
