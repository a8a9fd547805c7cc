"""A trace gives the commands of a run again, whatever the operator did in it."""

from __future__ import annotations

from math import nan
from pathlib import Path

import attrs
from law_helpers import Chain
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.replay import replay, TraceWriter

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
            applied = controller.command
            u = controller.tick(y, H, elapsed=H, age=age, reference=[1.0])
            trace.tick(controller, y, H, H, age, [1.0], applied)
            chain.advance(u * controller.settings.b0, H)

    turn()  # before the first tick, in a trace that does not say so
    controller.enabled = True
    run(40)
    controller.enabled = False
    turn()
    controller.enabled = True
    run(40)
    trace.close()
    pairs = list(replay(path))
    assert len(pairs) == 80
    assert all(recorded == again for recorded, again in pairs)
    assert len(set(pairs)) > 20
