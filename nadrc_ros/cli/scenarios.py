"""`nadrc scenarios`: what comes with the package."""

from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import say


def scenarios() -> None:
    """
    List the scenarios that come with the package.

    Each runs by its name; a copy of its file is the start of one of your own.

    Example: nadrc scenarios, and then nadrc simulate altitude --plot altitude.png
    """
    with reporting():
        from nadrc_ros.scenario import load
        from nadrc_ros.scenario.files import purpose_of, shipped_scenarios

        found = shipped_scenarios()
        longest = max(map(len, found), default=0) + 2
        for name, path in found.items():
            scenario = load(path)
            say(f'{name:{longest}}{purpose_of(path)}', ' ' * longest)
            plant, order = scenario.plant.name, next(iter(scenario.controllers.values()))
            facts = f'{plant}, order {order.plant_order}, {scenario.duration:g} s at '
            facts += f'{scenario.rate:g} Hz: {", ".join(scenario.controllers)}'
            say(' ' * longest + facts, ' ' * longest)
        for folder in {path.parent for path in found.values()}:
            say(f'in {folder}')
