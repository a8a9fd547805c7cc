"""
What a test or a script of a user's needs to run the nodes in its own process, without launch.

The public names are those of ``__all__``; they stay.
"""

from nadrc_ros.demo.loop_processes import GraphError
from nadrc_ros.ros.runtime import private_domain
from nadrc_ros.testing.loops import loop, scenario_loop
from nadrc_ros.testing.running_loop import RunningLoop, spin_until

__all__ = ['GraphError', 'RunningLoop', 'loop', 'private_domain', 'scenario_loop', 'spin_until']
