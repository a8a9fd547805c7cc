"""The description of an experiment: reads and writes YAML, loads the plant file of a user."""

from nadrc_ros.scenario.files import dump, find_scenario, load, loads
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.specs import PLANT, PlantSpec, SIGNAL, SignalSpec
from nadrc_ros.scenario.user_code import ScenarioError

__all__ = [
    'PLANT',
    'SIGNAL',
    'PlantSpec',
    'Scenario',
    'ScenarioError',
    'SignalSpec',
    'dump',
    'find_scenario',
    'load',
    'loads',
]
