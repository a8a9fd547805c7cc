"""Spinning for ever must not fill the memory."""

from __future__ import annotations

from collections.abc import Callable
import gc
import sys

from nadrc_ros.nodes.runtime import make_executor, spin_until
from probe import Probe
import pytest
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
    spin_until(probe.executor, probe.node, lambda: len(blocks) >= 2)
    print(f'{blocks[1] - blocks[0]} blocks more after {CALLBACKS} callbacks')
    assert blocks[1] - blocks[0] < CALLBACKS // 2
