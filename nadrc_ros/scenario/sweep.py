"""A sweep: a scenario, what varies in it by dotted path, and the seeds; read from YAML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from hashlib import sha256
from itertools import groupby
import json
from math import prod
from operator import itemgetter
from pathlib import Path
import re
from typing import Any

import attrs
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UserError
from nadrc_ros.adrc.fields import refuse_unknown_keys
from nadrc_ros.scenario.files import find_scenario, read_text
from nadrc_ros.scenario.mapping import from_mapping, refuse_other_kinds
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.user_code import blame, ScenarioError
from nadrc_ros.simulation.batch import run_metrics, RunMetrics
from nadrc_ros.yaml_text import read_yaml, write_yaml
import numpy as np

_KEYS = ('scenario', 'vary', 'seeds')
_DOTTED_PATH = re.compile(r'\w+(\.\w+|\[\d+\])*')
# What a bare name stands for where a mapping may be.
_BARE_NAME = {'plant': 'name', 'reference': 'signal', 'disturbance': 'signal'}
_LARGEST_SEED = 2**63 - 1


@attrs.frozen(kw_only=True)
class Extent:
    """How much a sweep is: its runs, the periods of all of them, the files they read."""

    runs: int
    periods: int
    files: tuple[str, ...]


@attrs.frozen(kw_only=True)
class Sweep:
    """
    Every combination of the values that vary, with every controller and every seed.

    Runs are numbered in the order of nested loops over ``vary``, controllers and seeds, the seed
    changing fastest.

    Attributes
    ----------
    scenario
        The plain data of a scenario, as a file holds it.
    folder
        Where a plant file is sought.
    vary
        The values by dotted path, as in error messages: ``controllers.nested.inner_bandwidth``.
    seeds
        Of the noise and all else that is random.

    """

    scenario: dict[str, Any]
    folder: str
    vary: dict[str, tuple[Any, ...]]
    seeds: Sequence[int]

    @property
    def controllers(self) -> tuple[str, ...]:
        """Return the names of the controllers, the same at every point."""
        return tuple(self.scenario['controllers'])

    def check(self) -> Extent:
        """
        Validate every point, before the first run.

        Raises
        ------
        SettingError, ScenarioError
            What is wrong, and at which point.

        """
        each = len(self.controllers) * len(self.seeds)
        runs, steps, files = 0, 0, set[str]()
        for point in range(self.points):
            scenario = self.at(point)
            runs += each
            steps += each * scenario.experiment.steps
            files.update(scenario.files)
        return Extent(runs=runs, periods=steps, files=tuple(sorted(files)))

    @property
    def points(self) -> int:
        """Return the number of combinations."""
        return prod(map(len, self.vary.values()))

    def values(self, point: int) -> dict[str, Any]:
        """Return what varies, at that point."""
        places = np.unravel_index(point, [len(values) for values in self.vary.values()])
        return {path: values[i] for (path, values), i in zip(self.vary.items(), places)}

    def at(self, point: int) -> Scenario:
        """Return the scenario at that point, raising as :meth:`check` does."""
        values = self.values(point)
        data = deepcopy(self.scenario)
        for path, value in values.items():
            _place(data, path, value)
        try:
            return from_mapping(data, self.folder)
        except UserError as error:
            raise _at(error, values) from None

    def key(self, run: int) -> tuple[int, str, int]:
        """Return point, controller and seed of a run."""
        shape = self.points, len(self.controllers), len(self.seeds)
        point, controller, seed = map(int, np.unravel_index(run, shape))
        return point, self.controllers[controller], self.seeds[seed]

    def describe(self, files: tuple[str, ...]) -> str:
        """Return the sweep as YAML, with the digests of the user's files: equal for equal runs."""
        vary = {path: list(values) for path, values in self.vary.items()}
        seeds = len(self.seeds) if isinstance(self.seeds, range) else list(self.seeds)
        text = write_yaml({'scenario': self.scenario, 'vary': vary, 'seeds': seeds})
        digests = [f'# {file} {sha256(Path(file).read_bytes()).hexdigest()}\n' for file in files]
        return ''.join((text, *digests))


def run_range(
    sweep: Sweep,
    start: int,
    stop: int,
    compiled: bool,
    say: Callable[[str], None] | None = None,
) -> list[RunMetrics]:
    """
    Return the figures of merit of the runs from ``start`` to before ``stop``.

    Raises
    ------
    ScenarioError
        When the code of a user's plant fails; says at which point.

    """
    found = []
    for point, runs in groupby(map(sweep.key, range(start, stop)), key=itemgetter(0)):
        scenario = sweep.at(point)
        try:
            with blame(*scenario.code):
                for _, name, seed in runs:
                    settings = scenario.controllers[name]
                    found.append(run_metrics(scenario.experiment, settings, seed, compiled, say))
        except UserError as error:
            raise _at(error, sweep.values(point)) from None
    return found


def load_sweep(path: str | Path) -> Sweep:
    """
    Read a sweep file; its scenario is inline, a file beside it, or a shipped one by its name.

    Raises
    ------
    SettingError, ScenarioError
        What is wrong with the file; a value may still be, which :meth:`Sweep.check` finds.

    """
    data = _read(path, 'a sweep is a mapping of scenario, vary and seeds')
    refuse_other_kinds(data, 'sweep')
    refuse_unknown_keys(data, _KEYS)
    scenario, folder = _scenario(data.get('scenario'), Path(path).parent)
    if not isinstance(scenario.get('controllers'), dict):
        raise SettingError(
            'scenario.controllers', scenario.get('controllers'), 'a mapping of keys to values'
        )
    return Sweep(
        scenario=scenario,
        folder=str(folder),
        vary=_vary(data.get('vary') or {}, scenario),
        seeds=_seeds(data.get('seeds', [scenario.get('seed', 0)])),
    )


def cell(value: Any) -> str:
    """Return a varied value as text for a table, never with a line break."""
    plain = isinstance(value, str) and value.isprintable()
    return str(value) if plain else json.dumps(value)


def _read(path: str | Path, needed: str) -> dict[str, Any]:
    data = read_yaml(read_text(path))
    if not isinstance(data, dict):
        raise ScenarioError(needed)
    return data


def _scenario(given: Any, folder: Path) -> tuple[dict[str, Any], Path]:
    if isinstance(given, dict):
        return given, folder
    if not isinstance(given, str):
        raise SettingError(
            'scenario', given, 'the name of a shipped scenario, a file, or a scenario itself'
        )
    beside = folder / given
    try:
        path = find_scenario(beside if beside.is_file() else given)
        return _read(path, 'a mapping is needed there'), path.parent
    except ScenarioError as error:
        raise ScenarioError(f'scenario {given}: {error}') from None


def _vary(given: Any, scenario: dict[str, Any]) -> dict[str, tuple[Any, ...]]:
    if not isinstance(given, dict):
        raise SettingError('vary', given, 'a mapping of dotted paths to lists of values')
    for path, values in given.items():
        if not isinstance(path, str) or not _DOTTED_PATH.fullmatch(path):
            raise SettingError('vary', path, 'a dotted path, such as plant.a3 or retune[0].time')
        if path == 'seed':
            raise SettingError('vary.seed', values, 'left out: the seeds are given by seeds')
        if path == 'controllers':
            raise SettingError(
                'vary.controllers', values, 'the path of one controller, or of a setting of it'
            )
        if not isinstance(values, list) or not values:
            raise SettingError(f'vary.{path}', values, 'a list of at least one value')
        if len({cell(value) for value in values}) < len(values):
            raise SettingError(f'vary.{path}', values, 'a list of different values')
        _place(deepcopy(scenario), path, values[0])
    return {path: tuple(values) for path, values in given.items()}


def _seeds(given: Any) -> Sequence[int]:
    """Take a list as it is, and a number as that many seeds from 0 on."""
    if type(given) is int and given > 0:
        return range(given)
    seeds = given if isinstance(given, list) else []
    fine = all(type(seed) is int and 0 <= seed <= _LARGEST_SEED for seed in seeds)
    if not (seeds and fine and len(set(seeds)) == len(seeds)):
        raise SettingError('seeds', given, 'how many, or a list of different integers from 0 on')
    count = range(len(seeds))
    return count if seeds == list(count) else tuple(seeds)


def _place(data: dict[str, Any], path: str, value: Any) -> None:
    """
    Set what ``path`` names; only what it ends in, or begins with, may not be there yet.

    A key that is mistyped on the way would else be one more: ``controllers.nestd.b0`` would add a
    controller, and nothing that was meant would vary.
    """
    *before, last = (int(step) if step.isdigit() else step for step in re.findall(r'\w+', path))
    inside: Any = data
    at = ''
    for step in before:
        new = not at and isinstance(step, str)
        there = inside.get(step) if new else inside[_known(step, inside, path, at)]
        if isinstance(there, str) and step in _BARE_NAME:
            there = {_BARE_NAME[step]: there}
        inside[step] = inside = {} if there is None else there
        at = f'{at}.{step}' if at else str(step)
    if isinstance(last, int) or not isinstance(inside, dict):
        _known(last, inside, path, at)
    inside[last] = value


def _known(step: Any, inside: Any, path: str, at: str) -> Any:
    there = range(len(inside)) if isinstance(inside, list) else inside
    there = there if isinstance(inside, (list, dict)) else ()
    if step not in there:
        words = f'in {at or "the scenario"}: {did_you_mean(str(step), map(str, there))}'
        raise SettingError('vary', path, f'a path in the scenario; {words}')
    return step


def _at(error: UserError, values: dict[str, Any]) -> UserError:
    """Say at which point it was, unless there is but one."""
    if not values:
        return error
    point = ', '.join(f'{path} = {cell(value)}' for path, value in values.items())
    return ScenarioError(f'{error} (at {point})')
