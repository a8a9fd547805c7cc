"""What the options of a command change in a scenario."""

from typing import Any, TYPE_CHECKING

from nadrc_ros.cli.failure import complain

if TYPE_CHECKING:
    from nadrc_ros.scenario import Scenario


def changed(whole: 'Scenario', **options: Any) -> 'Scenario':
    """Return the scenario with other values, and say which retunes are left out for that."""
    scenario = whole.changed(**options)
    for retune in whole.retunes:
        if retune in scenario.retunes:
            continue
        complain(f'the retune at {retune.time:g} s lies after the end and is left out')
    return scenario
