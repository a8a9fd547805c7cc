"""Spinning for ever must neither fill the memory nor leave a callback out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import gc
import sys
import time

from nadrc_ros.ros.pacing import SharedTimer, TOLERABLE
from nadrc_ros.ros.versions import make_executor, spin_for, spin_until_over
from probe import Probe
import pytest
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor

CALLBACKS = 500


@pytest.mark.parametrize('executor', [make_executor, SingleThreadedExecutor])
def test_p20_no_callback_leaves_memory_behind(
    executor: Callable[[], object], make_probe: Callable[..., Probe]
) -> None:
    probe = make_probe(executor=executor)
    calls, blocks = 0, []

    def count() -> None:
        nonlocal calls
        calls += 1
        if calls % CALLBACKS == 0:
            gc.collect()
            blocks.append(sys.getallocatedblocks())

    probe.node.create_timer(0.002, count)
    spin_until_over(probe.executor, probe.node, lambda: len(blocks) >= 2)
    print(f'{blocks[1] - blocks[0]} blocks more after {CALLBACKS} callbacks')
    assert blocks[1] - blocks[0] < CALLBACKS // 2


@pytest.mark.parametrize(('rate', 'phase'), [(100.0, 0.0), (100.0, 0.5), (30.0, 0.5)])
def test_a_timer_is_in_phase_with_those_of_other_nodes(
    make_probe: Callable[..., Probe], rate: float, phase: float
) -> None:
    """Each ms that r leaves before y cost the demo 0.9 % of its ITAE against the simulation."""
    probe = make_probe()
    time.sleep(0.013)
    timer, heard = SharedTimer(probe.node, rate, phase=phase), []
    timer.listeners.append(lambda: heard.append(timer.now()))
    time.sleep(0.05)  # as a node that has more to set up
    probe.wait_until(lambda: len(heard) > 5)
    period = 1e9 / rate
    off = [
        (before + timer.timer.time_until_next_call()) / period - phase
        for before in (timer.now() for _ in range(20))
    ]
    assert min(abs(each - round(each)) for each in off) < TOLERABLE + 0.01
    probe.wait_until(lambda: len(heard) > 10)
    assert len(heard) - 1 <= (heard[-1] - heard[0]) / period + 0.9


def test_no_callback_of_a_busy_node_starves(make_probe: Callable[..., Probe]) -> None:
    probe = make_probe(executor=SingleThreadedExecutor)
    counts = [0, 0, 0]

    def count(i: int) -> None:
        counts[i] += 1

    for i in range(3):  # each is due again when its callback ends
        probe.node.create_timer(
            1e-5, partial(count, i), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
    spin_for(probe.executor, 0.3)
    assert min(counts) > 0 and max(counts) < 1.5 * min(counts) + 3, counts
