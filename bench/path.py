"""
What the documented path is worth: from a guess to `identify`, `design` and `tune`, step by step.

    python -m bench.path

Twelve plants under a controller that somebody guessed. The log of each, with the parameters that
the recorder keeps, is identified; the suggested start, the design of the printed line and what
`tune` makes of the start run the same experiment on the true plant, with noise that nobody saw.

Keys: ``path.<plant>.<step>`` the ITAE over that of the guess, steps ``start``, ``design`` and
``tuned``; ``.peak`` the peak error over that of the guess.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from pathlib import Path
from shlex import split
from tempfile import TemporaryDirectory
from typing import Any

import attrs
from bench.identify import record
from bench.results import save, show
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.history import append_parameters, read_history
from nadrc_ros.records.read_run import read_run
from nadrc_ros.scenario import Scenario
from nadrc_ros.scenario.files import loads
from nadrc_ros.scenario.parameter_files import controller_parameters
from nadrc_ros.simulation.protocols import MutableVector, Vector
from nadrc_ros.simulation.simulate import simulate
from nadrc_ros.tuning.design.first_design import first_design
from nadrc_ros.tuning.design.requirements import Requirements
from nadrc_ros.tuning.identification.advice import (
    advise,
    NAME,
    reference_text,
    running_controller,
    scenario_of,
)
from nadrc_ros.tuning.identification.identify import identify
from nadrc_ros.tuning.identification.log import log_of
from nadrc_ros.tuning.search.score import Judge
from nadrc_ros.tuning.search.settings import TuneSettings
from nadrc_ros.tuning.search.variables import designed, first_designs, variables

SEEN, UNSEEN = 1, 7
DESIGNS = 60
FOLDER = Path(__file__).parent
MORE = 1.02  # effort that a tuning may spend beside that of the start
OWN = ('command_min', 'command_max', 'safe_command', 'reference_derivatives')
PLANTS = {
    'yaw behind a lag': """
plant: {file: path.py, class: Yaw}
reference: {signal: square, amplitude: 0.5, frequency: 0.8}
disturbance: {signal: sine, amplitude: 0.4, frequency: 0.5}
noise: {variance: 1e-6}
rate: 100
duration: 30
limits: {command_min: -10, command_max: 10}
controllers: {guess: {b0: 4, inner_bandwidth: 6, outer_bandwidth: 4, controller_bandwidth: 1.2}}
""",
    'oven': """
plant: {name: chain, order: 1, gain: 0.00667, damping: 0.00333, initial_state: [60]}
faults: {measurement: [{kind: delayed, time: 3}]}
reference: {signal: square, offset: 75, amplitude: 15, frequency: 0.005}
noise: {variance: 0.0025}
rate: 1
duration: 3600
limits: {command_min: 0, command_max: 100}
controllers: {guess: {structure: conventional, b0: 0.01, inner_bandwidth: 0.05,
  controller_bandwidth: 0.01, measurement_timeout: 5, max_dt: 5}}
""",
    'speed': """
plant: {name: chain, order: 1, gain: 40, damping: 4}
reference: {signal: square, offset: 10, amplitude: 5, frequency: 4}
disturbance: {signal: step, amplitude: -60, start_time: 3.1}
noise: {variance: 1e-3}
rate: 200
duration: 10
limits: {command_min: -12, command_max: 12}
controllers: {guess: {structure: conventional, b0: 60, inner_bandwidth: 20,
  controller_bandwidth: 5}}
""",
    'dead time': """
plant: {name: chain, order: 1, gain: 2, damping: 1}
faults: {measurement: [{kind: delayed, time: 0.17}]}
reference: {signal: square, amplitude: 1, frequency: 0.6}
disturbance: {signal: sine, amplitude: 0.3, frequency: 0.3}
noise: {variance: 1e-5}
rate: 100
duration: 40
limits: {command_min: -10, command_max: 10}
controllers: {guess: {structure: conventional, b0: 2.5, inner_bandwidth: 3,
  controller_bandwidth: 0.8}}
""",
    'mass': """
plant: {name: chain, order: 2, gain: 1.5}
reference: {signal: square, amplitude: 0.3, frequency: 0.8}
disturbance: {signal: step, amplitude: 1, start_time: 12}
noise: {variance: 1e-8}
rate: 200
duration: 24
limits: {command_min: -20, command_max: 20}
controllers: {guess: {b0: 1, inner_bandwidth: 15, outer_bandwidth: 10, controller_bandwidth: 3}}
""",
    'arm under gravity': """
plant: {name: chain, order: 2, gain: 4, damping: 2, load: 20}
reference: {signal: square, amplitude: 0.4, frequency: 1}
noise: {variance: 1e-7}
rate: 250
duration: 20
limits: {command_min: -12, command_max: 12}
controllers: {guess: {b0: 6, inner_bandwidth: 20, outer_bandwidth: 15, controller_bandwidth: 4}}
""",
    'axis behind a bus': """
plant: {name: chain, order: 2, gain: 2, damping: 1}
faults: {measurement: [{kind: delayed, time: 0.02}]}
reference: {signal: chirp, amplitude: 0.5, frequency: 0.5, end_frequency: 3, sweep_time: 30}
disturbance: {signal: sine, amplitude: 0.5, frequency: 0.9}
noise: {variance: 1e-7}
rate: 100
duration: 30
limits: {command_min: -20, command_max: 20}
controllers: {guess: {reference_derivatives: none,
  b0: 3, inner_bandwidth: 10, outer_bandwidth: 8, controller_bandwidth: 2}}
""",
    'noisy speed': """
plant: {name: chain, order: 1, gain: 10, damping: 0.5}
reference: {signal: square, amplitude: 2, frequency: 1}
disturbance: {signal: sine, amplitude: 5, frequency: 0.4}
noise: {variance: 0.01}
rate: 50
duration: 40
limits: {command_min: -5, command_max: 5}
controllers: {guess: {structure: conventional, b0: 8, inner_bandwidth: 4,
  controller_bandwidth: 1.5}}
""",
    'chain of three': """
plant: {name: chain, order: 3, gain: 2, damping: 0.5}
reference: {signal: chirp, frequency: 0.3, end_frequency: 3, sweep_time: 30}
disturbance: {signal: sine, amplitude: 2, frequency: 0.7}
noise: {variance: 1e-10}
rate: 100
duration: 30
limits: {command_min: -40, command_max: 40}
controllers: {guess: {reference_derivatives: none,
  b0: 3, inner_bandwidth: 15, outer_bandwidth: 10, controller_bandwidth: 2}}
""",
    'motor': """
plant: {name: motor}
reference: {signal: square, offset: 100, amplitude: 50, frequency: 6}
disturbance: {signal: step, amplitude: -2500, start_time: 2}
noise: {variance: 0.01}
rate: 1000
duration: 4
limits: {command_min: -24, command_max: 24}
controllers: {guess: {inner_bandwidth: 100, outer_bandwidth: 60, controller_bandwidth: 20}}
""",
    'paper': """
plant: {name: paper}
reference: {signal: chirp, frequency: 1, end_frequency: 2, sweep_time: 40}
disturbance: {signal: sine, frequency: 0.7}
noise: {variance: 1e-6}
rate: 100
duration: 40
limits: {command_min: -30, command_max: 30}
controllers: {guess: {reference_derivatives: none,
  inner_bandwidth: 15, outer_bandwidth: 10, controller_bandwidth: 3}}
""",
    'upside down': """
plant: {name: chain, order: 1, gain: -3, damping: -0.5}
reference: {signal: square, offset: 1, amplitude: 1, frequency: 1.5}
noise: {variance: 1e-4}
rate: 100
duration: 20
limits: {command_min: -10, command_max: 10}
controllers: {guess: {structure: conventional, b0: -4, inner_bandwidth: 8,
  controller_bandwidth: 3}}
""",
}


class Yaw:
    """y'' = -0.5 y' + 3 v + w, v the command behind a lag of 48 ms."""

    order, states, b0 = 2, 3, 3.0

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        dx[0], dx[1], dx[2] = x[1], -0.5 * x[1] + 3.0 * x[2] + w, (u - x[2]) / 0.048

    def output(self, x: Vector) -> float:
        """Return the angle."""
        return x[0]


def log_with_parameters(scenario: Scenario, directory: Path) -> Path:
    """Run the guess; return the folder that a recorder would have made, parameters included."""
    folder = record(scenario, directory)
    ((_, guess),) = scenario.controllers.items()
    append_parameters(folder, None, '/controller', controller_parameters(guess, scenario.rate))
    return folder


def requirements_of(line: str) -> Requirements:
    """Return what a printed `nadrc design ...` line asks for."""
    words = split(line)[2:]
    kinds, values = declared(Requirements), {}
    while words:
        name = words.pop(0).removeprefix('--').replace('-', '_')
        kind = type(kinds[name].default)
        values[name] = True if kind is bool else kind(words.pop(0))
    return build(Requirements, values)


def tuned(scenario: Scenario, designs: int) -> ControllerSettings:
    """Return the best of the first designs that a search tries, within the effort of the start."""
    start, budget = scenario.controllers[NAME], MORE * scenario.run(NAME).metrics.isu
    tuning = TuneSettings(budget=budget)
    judge = Judge(scenario, NAME, tuning, compiled=True)
    varied = variables(start, {}, scenario.rate, scenario.duration, tuning.largest_wh)
    best, least = start, inf
    for values in first_designs(start, varied, designs):
        score = judge.score(values)
        if score.figures and not score.violations and score.figures.objective < least:
            best, least = designed(start, values), score.figures.objective
    assert least < inf, 'the start itself is not sound'
    return best


def steps(text: str, designs: int = DESIGNS) -> dict[str, ControllerSettings]:
    """Return the settings of each step of the path."""
    scenario = loads(text, FOLDER).changed(seed=SEEN)
    ((_, guess),) = scenario.controllers.items()
    with TemporaryDirectory() as directory:
        folder = log_with_parameters(scenario, Path(directory))
        log, running = log_of(read_run(folder)), running_controller(read_history(folder))
        reference = Path(directory) / 'reference.csv'
        reference.write_text(reference_text(log), encoding='utf-8')
        plant = identify(log, guess.plant_order)
        advice = advise(plant, log, running)
        chosen = first_design(requirements_of(advice.line)).chosen.settings
        repeated = scenario_of(plant, log, advice.settings, reference)
        last = tuned(repeated, designs)
    # What only the robot's own parameter file says.
    own = {name: getattr(guess, name) for name in OWN}
    return {
        'guess': guess,
        'start': advice.settings,
        'design': attrs.evolve(chosen, **own),
        'tuned': last,
    }


def judged(text: str, found: Mapping[str, ControllerSettings]) -> dict[str, tuple[float, float]]:
    """Return ITAE and peak error of each step, on the true plant with unseen noise."""
    scenario = loads(text, FOLDER).changed(seed=UNSEEN)
    runs = {name: simulate(scenario.experiment, each).metrics for name, each in found.items()}
    return {name: (run.itae, run.peak_error) for name, run in runs.items()}


def path(text: str, designs: int = DESIGNS) -> dict[str, float]:
    """Return ITAE and peak error of each step over those of the guess."""
    figures = judged(text, steps(text, designs))
    itae, peak = figures.pop('guess')
    found = {step: own / itae for step, (own, _) in figures.items()}
    return found | {f'{step}.peak': largest / peak for step, (_, largest) in figures.items()}


def main(designs: int = DESIGNS, **where: Any) -> None:
    """Go the path of every plant."""
    found = {name: path(text, designs) for name, text in PLANTS.items()}
    figures = {f'{name}.{key}': v for name, each in found.items() for key, v in each.items()}
    save('path', figures, {}, **where)
    show('ITAE and peak error over those of the guess', found, 'Below 1 is better.')


if __name__ == '__main__':
    main()
