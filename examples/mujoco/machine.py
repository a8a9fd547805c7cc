"""
A machine in MuJoCo, in real time, that speaks what such machines speak; it knows nothing of ADRC.

    python examples/mujoco/machine.py arm      # JointState out, Float64MultiArray in
    python examples/mujoco/machine.py rover    # Odometry out, TwistStamped in

The arm takes torques [N m] and, as the effort controllers of ros2_control, keeps the last ones
when nobody sends any. The rover takes a speed and a turn rate, and stops after half a second
without any, as diff_drive_controller does. Needs `pip install mujoco`.
"""

from __future__ import annotations

from contextlib import suppress
from math import cos, sin
from pathlib import Path
import sys

from geometry_msgs.msg import TwistStamped
import mujoco
from nav_msgs.msg import Odometry
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

RATE = 200.0  # Hz
# After a stall no more than that is made up for [s].
MOST = 0.1
TIMEOUT = 0.5  # s


class Machine(Node):
    """Steps a model to the present, and publishes what is measured, RATE times a second."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        file = Path(__file__).with_name(f'{name}.xml')
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.data = mujoco.MjData(self.model)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.begin = self.seconds()
        self.create_timer(1.0 / RATE, self.advance, clock=self.steady)

    def seconds(self) -> float:
        """Return the time of a clock that is never set [s]."""
        now: int = self.steady.now().nanoseconds
        return now * 1e-9

    def advance(self) -> None:
        """Step to the present."""
        now = self.seconds() - self.begin
        if now - self.data.time > MOST:
            self.begin += now - self.data.time - MOST
            now = self.data.time + MOST
        self.drive()
        while self.data.time < now:
            mujoco.mj_step(self.model, self.data)
        self.publish()

    def drive(self) -> None:
        """Set the actuators."""

    def publish(self) -> None:
        """Publish what is measured."""


class Arm(Machine):
    """Two joints, by their names in the model."""

    def __init__(self) -> None:
        super().__init__('arm')
        self.joints = [self.model.joint(i).name for i in range(self.model.njnt)]
        self.states = self.create_publisher(JointState, 'joint_states', 10)
        self.create_subscription(Float64MultiArray, 'efforts', self.take, 10)

    def take(self, efforts: Float64MultiArray) -> None:
        """Take a torque for each joint."""
        if len(efforts.data) == len(self.joints):
            self.data.ctrl[:] = efforts.data

    def publish(self) -> None:
        """Publish the joints; what they carry is not measured."""
        states = JointState(name=self.joints)
        states.header.stamp = self.get_clock().now().to_msg()
        states.position = self.data.qpos.tolist()
        states.velocity = self.data.qvel.tolist()
        states.effort = [float('nan')] * len(self.joints)
        self.states.publish(states)


class Rover(Machine):
    """A rover with a drive of its own."""

    def __init__(self) -> None:
        super().__init__('rover')
        self.speed = self.turn = 0.0
        self.heard = self.seconds()
        self.odometry = self.create_publisher(Odometry, 'odom', 10)
        self.create_subscription(TwistStamped, 'cmd_vel', self.take, 10)

    def take(self, command: TwistStamped) -> None:
        """Take a speed and a turn rate."""
        self.speed, self.turn = command.twist.linear.x, command.twist.angular.z
        self.heard = self.seconds()

    def drive(self) -> None:
        """Drive as was asked for, unless that is long ago."""
        if self.seconds() - self.heard > TIMEOUT:
            self.speed = self.turn = 0.0
        yaw = self.data.qpos[2]
        self.data.ctrl[:] = self.speed * cos(yaw), self.speed * sin(yaw), self.turn

    def publish(self) -> None:
        """Publish where it is, and how fast it moves."""
        odometry = Odometry(child_frame_id='base_link')
        odometry.header.stamp = self.get_clock().now().to_msg()
        odometry.header.frame_id = 'odom'
        pose, twist = odometry.pose.pose, odometry.twist.twist
        x, y, yaw = self.data.qpos.tolist()
        pose.position.x, pose.position.y = x, y
        pose.orientation.z, pose.orientation.w = sin(0.5 * yaw), cos(0.5 * yaw)
        forward, sideways, turn = self.data.qvel.tolist()
        twist.linear.x = forward * cos(yaw) + sideways * sin(yaw)
        twist.angular.z = turn
        self.odometry.publish(odometry)


MACHINES = {'arm': Arm, 'rover': Rover}


def main() -> None:
    """Run the machine that the command line names."""
    if len(sys.argv) < 2 or sys.argv[1] not in MACHINES:
        raise SystemExit(f'which machine? {" or ".join(MACHINES)}')
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(MACHINES[sys.argv[1]]())


if __name__ == '__main__':
    main()
