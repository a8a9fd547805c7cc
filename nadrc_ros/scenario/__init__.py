"""The description of an experiment: reads and writes YAML, loads the plant file of a user."""

from nadrc_ros.scenario.errors import ScenarioError
from nadrc_ros.scenario.files import dump, find_scenario, load, loads
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.scenario.user_plant import load_plant

__all__ = [
    'PlantSpec',
    'Scenario',
    'ScenarioError',
    'SignalSpec',
    'dump',
    'find_scenario',
    'load',
    'load_plant',
    'loads',
]
