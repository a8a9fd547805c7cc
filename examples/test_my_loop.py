"""
Tests of a loop of one's own, without launch: a plant, faults, a live change, and the error.

    python -m pytest examples/test_my_loop.py
"""

from __future__ import annotations

from collections.abc import Callable

from nadrc_ros.adrc.status import Mode
from nadrc_ros.testing import loop
import pytest
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor


class Cart:
    """A cart with drag on a hilly road: y'' = 2 u - drag y' + w, with y in m and u in V."""

    order = 2
    states = 2
    b0 = 2.0

    def __init__(self, drag: float = 0.5) -> None:
        self.drag = drag

    def derivative(self, t: float, x: list[float], u: float, w: float, dx: list[float]) -> None:
        """Write dx/dt into ``dx``; ``w`` is the disturbance."""
        dx[0] = x[1]
        dx[1] = 2.0 * u - self.drag * x[1] + w

    def output(self, x: list[float]) -> float:
        """Return what is measured."""
        return x[0]


@pytest.fixture(params=[SingleThreadedExecutor, EventsExecutor])
def executor(request: pytest.FixtureRequest) -> Callable[..., Executor]:
    """Return an executor of rclpy."""
    made: Callable[..., Executor] = request.param
    return made


def test_the_cart_follows_with_a_weak_motor_and_better_once_retuned(
    executor: Callable[..., Executor],
) -> None:
    """Run in lockstep: faster than real time, with the same bits on every machine."""
    hills = {'disturbance': 'sine', 'disturbance_amplitude': 3.0, 'disturbance_frequency': 1.5}
    with loop(
        plant={'plant': Cart, 'drag': 0.8, **hills},
        controller={'controller_bandwidth': 5.0, 'inner_bandwidth': 10.0, 'outer_bandwidth': 5.0},
        reference={'signal': 'cosine', 'frequency': 0.8},
        rate=50.0,
        duration=6.0,
        lockstep=True,
        executor=executor,
    ) as run:
        run.run_until(2.0)
        run.change('plant', {'fault.command.kind': 'gain', 'fault.command.size': 0.7})
        run.run_until(4.0)
        run.change(inner_bandwidth=25.0, outer_bandwidth=12.5)
        result = run.finish()

    error, time = abs(result.reference - result.output), result.time
    assert error[(time > 1.0) & (time < 2.0)].max() < 0.1
    assert error[(time > 2.0) & (time < 4.0)].max() < 0.15
    assert error[time > 5.0].max() < 0.02


def test_the_command_is_safe_soon_after_the_sensor_is_silent(
    executor: Callable[..., Executor],
) -> None:
    """Run in real time, with the timers and the timeouts of the robot."""
    with loop(
        plant=Cart,
        controller={'measurement_timeout': 0.1, 'hold_time': 0.1, 'safe_command': -0.5},
        reference='cosine',
        rate=100.0,
        executor=executor,
    ) as run:
        run.run_until(0.3)
        run.change('plant', {'fault.measurement.kind': 'silent'})
        run.wait_until(lambda: run.controller.controller.mode == Mode.SAFE, timeout=5.0)
        assert run.controller.controller.command == -0.5
