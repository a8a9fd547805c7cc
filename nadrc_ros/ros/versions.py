"""
What depends on the version of rclpy and of its middleware, each with the one that is over it.

Tried with rclpy 7.1.6 (Jazzy, Fast DDS 2.14) and 9.1.2 (Kilted, Fast DDS 3.2). "Still so in 9.1.2"
means that no version is known yet that is not.
"""

from __future__ import annotations

from collections.abc import Callable
import functools
from importlib.metadata import PackageNotFoundError, version
import os
import time
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

# Whether all is over is looked at so often [s].
_POLL = 0.05
# So much longer than asked for may a spin take that waits for one callback [s].
_LONGEST_WAIT = 0.02
_LONG = 60.0


def distribution() -> str:
    """Return the name of this ROS distribution: the one that is sourced, or that of the wheels."""
    if sourced := os.environ.get('ROS_DISTRO'):
        return sourced
    try:
        version('ros-kilted-rclpy')
    except PackageNotFoundError:
        return 'jazzy'
    return 'kilted'


def make_executor(context: Context | None = None) -> Executor:
    """
    Return the executor with the least latency and load that this rclpy has.

    Before rclpy 7.1.4 there is no EventsExecutor.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def spin_for(executor: Executor, seconds: float, done: Future | None = None) -> None:
    """
    Run callbacks for some time, or until ``done`` is.

    An untimed spin of the EventsExecutor never returns (a time overflow, mended in 7.1.8; still so
    in 9.1.2), so nothing here spins without a timeout. Nor do the others spin until a future is
    complete: before 7.7.0 they add one more to those of the future with every callback. They take
    one callback at a time, and look anew at all that a node has whenever the timeout changes.
    """
    done = done or Future()
    if not isinstance(executor, Executor):
        executor.spin_until_future_complete(done, timeout_sec=seconds)
        return
    end = time.monotonic() + seconds
    while not done.done() and time.monotonic() < end:
        executor.spin_once(timeout_sec=min(seconds, _LONGEST_WAIT))


def spin_until_over(executor: Executor, node: Node, over: Callable[[], object]) -> None:
    """
    Run callbacks until ``over()``, which is looked at every _POLL seconds.

    It is a timer of the node that looks, as each return from a spin of the EventsExecutor leaks
    memory (a block each, 7.1.6, still so in 9.1.2); its ``spin_once`` does not, but misses
    periods of fast timers.
    """
    done = Future()

    def look() -> None:
        if over():
            done.set_result(None)

    node.create_timer(_POLL, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
    while not done.done():
        spin_for(executor, _LONG, done)


def with_info(callback: Callable[[Any, dict[str, Any]], None]) -> Callable[..., None]:
    """
    Return a callback of a message and its info that works on every executor.

    The EventsExecutor passes both as ONE tuple (7.1.6, still so in 9.1.2), and a function of two
    arguments ends with "SystemError: null argument to internal routine".
    """

    @functools.wraps(callback)
    def call(*args: Any) -> None:
        message, info = args if len(args) == 2 else args[0]
        callback(message, info)

    return call


def guard_transitions(node: Any, refuse: Callable[[str], None]) -> None:
    """
    Have a managed node refuse a transition that its state does not allow, and say which it does.

    Before rclpy 8.0.0 such a request raises in the callback and so ends the node.
    """
    service = node._service_change_state
    change = service.callback

    def answer(request: Any, response: Any) -> Any:
        wanted, machine = request.transition, node._state_machine
        possible = {number: label for number, label, *_ in machine.available_transitions}
        if wanted.label in possible.values() or (not wanted.label and wanted.id in possible):
            return change(request, response)
        refuse(
            f'the transition {wanted.label or wanted.id} is not possible while '
            f'{machine.current_state[1]}; possible: {", ".join(possible.values()) or "none"}'
        )
        response.success = False
        return response

    service.callback = answer


def choose_transport() -> None:
    """
    Have Fast DDS talk over UDP only, unless the environment says otherwise.

    A process that is killed while it starts can leave shared memory of Fast DDS 2.14 unfinished,
    and who opens that waits for ever: the controller, too, in ``publish``, for a dead recorder.
    Where discovery is LOCALHOST, rmw_fastrtps opens shared memory all the same (8.4, still
    so in 9.3).
    """
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
