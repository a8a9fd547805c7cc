"""A trace gives the commands of a run again, whatever the operator did in it."""

from __future__ import annotations

from math import nan
from pathlib import Path

import attrs
from law_helpers import Chain
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.step_trace import replay, TraceWriter

H = 0.01


def test_p18_another_sign_of_b0_is_replayed_though_no_tick_says_that_the_loop_was_open(
    tmp_path: Path,
) -> None:
    path = tmp_path / 'trace.jsonl'
    controller = Controller(ControllerSettings(measurement_timeout=0.05), enabled=False)
    trace = TraceWriter(path, controller.settings)
    chain = Chain(2)

    def turn() -> None:
        turned = attrs.evolve(controller.settings, b0=-controller.settings.b0)
        controller.retune(turned)
        trace.settings(turned)

    def run(ticks: int) -> None:
        for i in range(ticks):
            y, age = (chain.y, 0.04) if i % 8 < 6 else (nan, 0.0)
            u = controller.tick(y, H, elapsed=H, age=age, reference=[1.0])
            trace.tick(controller, [1.0])
            chain.advance(u * controller.settings.b0, H)

    def disable() -> None:
        controller.enabled = False
        trace.disabled()

    disable()
    turn()  # before the first tick
    controller.enabled = True
    run(40)
    disable()
    turn()
    controller.enabled = True
    run(40)
    trace.close()
    pairs = list(replay(path))
    assert len(pairs) == 80
    assert all(recorded == again for recorded, again in pairs)
    assert len(set(pairs)) > 20


def test_p18_a_stall_that_was_ended_between_two_ticks_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / 'trace.jsonl'
    controller = Controller(ControllerSettings(stall_time=0.2, stall_action='fault'), checked=True)
    trace = TraceWriter(path, controller.settings, checked=True)
    for i in range(200):
        if i == 100:
            controller.enabled = False
            trace.disabled()
            controller.enabled = True
        if i == 10:  # in the middle of the stall, whose time goes on
            controller.retune(controller.settings)
            trace.settings(controller.settings)
        controller.tick(0.0, H, reference=[1e3])
        trace.tick(controller, [1e3])
    trace.close()
    commands = [u for u, _ in replay(path)]
    assert commands == [again for _, again in replay(path)]
    assert commands[90] == 0.0 and commands[110] == 100.0
