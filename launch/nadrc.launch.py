"""
A loop in one namespace: `ros2 launch nadrc_ros nadrc.launch.py namespace:=axis1`.

An argument that is left empty leaves the matter to ``params_file``, and what that does not say to
the defaults of the nodes. When the controller ends, so does the rest.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from nadrc_ros.adrc.structures import STRUCTURES

from launch import LaunchContext, LaunchDescription

NODES = ('plant', 'reference', 'controller', 'recorder')


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the nodes follow from them."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
            DeclareLaunchArgument(
                'nodes',
                default_value=' '.join(NODES),
                description='which nodes, for instance "controller recorder" on a real plant',
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value='',
                description='parameter file (YAML) of the nodes; /**/controller names one of them',
            ),
            DeclareLaunchArgument(
                'structure',
                default_value='',
                choices=['', *STRUCTURES],
                description='observer structure of the controller',
            ),
            DeclareLaunchArgument(
                'rate', default_value='', description='periods per second of all nodes [Hz]'
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='',
                choices=['', 'false', 'true'],
                description='whether all nodes take the time from /clock',
            ),
            DeclareLaunchArgument(
                'remappings',
                default_value='',
                description='of topics, for instance "measurement:=/imu/yaw command:=/motor"',
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Node]:
    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    # launch would start some nodes before it misses one, and all of them without a missing file.
    nodes, file = given('nodes').split(), given('params_file')
    if not nodes or not set(nodes) <= set(NODES):
        raise ValueError(f'nodes = {given("nodes")!r}: must be some of {" ".join(NODES)}')
    if file and not Path(file).is_file():
        raise FileNotFoundError(f'params_file = {file!r}: there is no such file')
    remappings = [tuple(rule.split(':=')) for rule in given('remappings').split()]
    if not all(len(rule) == 2 and all(rule) for rule in remappings):
        raise ValueError(f'remappings = {given("remappings")!r}: must be rules like topic:=other')
    everywhere: dict[str, bool | float] = {}
    if given('use_sim_time'):
        everywhere['use_sim_time'] = given('use_sim_time') == 'true'
    if given('rate'):
        everywhere['rate'] = float(given('rate'))  # 200 is no 200.0 for ROS
    own = {'controller': {'structure': given('structure')} if given('structure') else {}}
    return [
        Node(
            package='nadrc_ros',
            executable=node,
            namespace=given('namespace'),
            name=node,
            parameters=[p for p in (file, everywhere | own.get(node, {})) if p],
            remappings=remappings,
            output='screen',
            on_exit=[Shutdown(reason='the controller ended')] if node == 'controller' else None,
        )
        for node in nodes
    ]
