"""
The driver of a motor on the bench: an encoder in, a voltage out, and a timeout of its own.

    python examples/bench/driver.py

As it is, a motor in MuJoCo stands in for yours (`pip install mujoco`). For yours, write a class
with the two methods of `Simulated` and name it in `main`.
"""

from __future__ import annotations

from math import pi
from pathlib import Path
from time import monotonic

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float64

RATE = 200.0  # Hz
COUNTS = 4096  # of the encoder for one turn of the shaft
VOLTS = 12.0  # of the supply
TIMEOUT = 0.1  # s without a command: the motor is switched off


class Simulated:
    """A motor in MuJoCo in place of two pins of an encoder and of a driver."""

    def __init__(self) -> None:
        import mujoco

        self.model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name('motor.xml')))
        self.data = mujoco.MjData(self.model)
        self.step = mujoco.mj_step
        self.begin = monotonic()

    def counts(self) -> int:
        """Return what the encoder has counted."""
        while self.data.time < monotonic() - self.begin:
            self.step(self.model, self.data)
        angle: float = self.data.qpos[0]
        return round(angle / (2.0 * pi) * COUNTS)

    def drive(self, duty: float) -> None:
        """Set the duty cycle of the driver, from -1 to 1."""
        self.data.ctrl[0] = duty * VOLTS


class Driver(Node):
    """Publishes the angle [rad] and takes the voltage [V]."""

    def __init__(self, motor: Simulated) -> None:
        super().__init__('driver')
        self.motor = motor
        self.heard = -TIMEOUT
        self.angle = self.create_publisher(Float64, 'measurement', 1)
        self.create_subscription(Float64, 'command', self.take, 1)
        self.create_timer(1.0 / RATE, self.measure, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def measure(self) -> None:
        """Publish the angle; switch off where nobody commands."""
        if monotonic() - self.heard > TIMEOUT:
            self.motor.drive(0.0)
        self.angle.publish(Float64(data=self.motor.counts() * 2.0 * pi / COUNTS))

    def take(self, volts: Float64) -> None:
        """Take a voltage."""
        self.heard = monotonic()
        self.motor.drive(max(-1.0, min(1.0, volts.data / VOLTS)))


def main() -> None:
    """Drive until Ctrl-C, and switch the motor off."""
    rclpy.init()
    motor = Simulated()
    try:
        rclpy.spin(Driver(motor))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # Ctrl-C while it publishes
        if rclpy.ok():
            raise
    finally:
        motor.drive(0.0)


if __name__ == '__main__':
    main()
