"""Writes docs/scenarios.md, what is in config/, from its files: `python docs/scenarios.py`."""

from __future__ import annotations

from pathlib import Path

from nadrc_ros.scenario import load
from nadrc_ros.scenario.files import purpose_of

PAGE = Path(__file__).with_name('scenarios.md')
CONFIG = PAGE.parents[1] / 'config'
INTRODUCTION = """# Scenarios

Here you find the scenarios that come with the package, to run them and to copy one as the start of
yours. Each runs by its name, offline or as ROS 2 processes (made by `python docs/scenarios.py`):

```bash
nadrc simulate altitude --plot altitude.png --json altitude.json
nadrc demo thermal --lockstep
```

(`nadrc` is `.venv/bin/nadrc` after `make demo` or `make test`, and on the `PATH` of a sourced
workspace or a pip install.)

`units: {output: rad, command: V}` goes to every axis and table of the [report](report.md); a
recorder has the parameters `units.output` and `units.command`.

`nadrc scenarios` lists them. A copy of a file is the start of a scenario of your own. The tests
run every one of them and check that the error settles and the command stays within its limits.

Plants and signals of your own: [own.md](own.md). `rate` may be as low as 0.001 Hz; a controller
that does not name `measurement_timeout` and `max_dt`
has 5 and 10 periods, at least 0.25 and 0.5 s.
"""


def page() -> str:
    """Return the whole page: those of a plant first, those of the paper last."""
    paths = sorted(CONFIG.glob('*.yaml'), key=lambda path: (path.stem.startswith('paper'), path))
    return (
        '\n'.join([INTRODUCTION, '| name | what | facts |', '|---|---|---|', *map(_row, paths)])
        + '\n'
    )


def _row(path: Path) -> str:
    """Return the row of one scenario."""
    scenario = load(path)
    settings = next(iter(scenario.controllers.values()))
    low, high = settings.command_min, settings.command_max
    facts = (
        f'`{scenario.plant.name}`, order {settings.plant_order}',
        f'{scenario.rate:g} Hz, {scenario.duration:g} s',
        'no limits' if high - low > 1e6 else f'command {low:g} to {high:g}',
        ', '.join(scenario.controllers),
    )
    return f'| [{path.stem}](../config/{path.name}) | {purpose_of(path)} | {"<br>".join(facts)} |'


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
