"""Loops of `nadrc_ros.testing` that cannot go on, or not be: each says why, and at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import math
from pathlib import Path
import re
import time
from typing import Any

from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.testing import GraphError, loop, RunningLoop
import pytest
from rclpy.experimental import EventsExecutor


class Tank:
    """A plant of one's own: y' = 2 u + w."""

    order = states = 1
    b0 = 2.0

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        dx[0] = self.b0 * u + w

    def output(self, x: Any) -> float:
        return float(x[0])


class Late(Tank):
    """A plant that goes wrong in the middle of a run, in the way that ``fault`` comes to say."""

    fault = ''

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        super().derivative(t, x, u, w, dx)
        if self.fault == 'code':
            raise ValueError('no table entry')
        if self.fault == 'state':
            dx[0] = math.nan
        if self.fault == 'far':
            dx[0] = math.sin(x[0] * 1e300) if abs(x[0]) > 1e30 else 1e60

    def output(self, x: Any) -> float:
        return math.nan if self.fault == 'output' else float(x[0])


@contextmanager
def late(fault: str, lockstep: bool) -> Iterator[RunningLoop]:
    with loop(plant=Late, reference='cosine', rate=100.0, duration=0.3, lockstep=lockstep) as run:
        run.run_until(0.1)
        plant: Any = run.plant.process.plant
        plant.fault = fault
        yield run


@pytest.mark.parametrize('lockstep', [True, False])
def test_what_a_plant_raises_in_the_middle_of_a_run_is_raised_with_its_line(
    lockstep: bool,
) -> None:
    with (
        late('code', lockstep) as run,
        pytest.raises(ValueError, match='no table entry') as caught,
    ):
        run.finish()
    assert caught.traceback[-1].name == 'derivative'


@pytest.mark.parametrize('lockstep', [True, False])
@pytest.mark.parametrize('fault', ['state', 'far', 'output'])
def test_a_plant_that_diverges_gives_no_figures_at_the_end(fault: str, lockstep: bool) -> None:
    with late(fault, lockstep) as run:
        with pytest.raises(UserError, match=r'plant: the plant diverged at t = 0\.[12]'):
            run.finish()
        assert math.isnan(run.result().output[-1])
        assert any(event.kind == 'diverged' for event in run.events())


def test_two_loops_of_one_namespace_are_refused() -> None:
    quick: dict[str, Any] = {'plant': Tank, 'rate': 50.0, 'duration': 0.1, 'namespace': 'x'}
    with loop(**quick) as run:
        for executor in (EventsExecutor, run.executor):
            said = "namespace = 'x': must be one that no other"
            with pytest.raises(SettingError, match=said), loop(executor=executor, **quick):
                pass
        assert len(run.finish().time)  # however late on a busy machine
    with loop(lockstep=True, **quick) as run:
        assert len(run.finish().time) == 5


@pytest.mark.parametrize('lockstep', [True, False])
def test_a_loop_that_has_ended_says_so(lockstep: bool, tmp_path: Path) -> None:
    for directory in (None, tmp_path):
        with loop(
            plant=Tank, rate=50.0, duration=0.1, lockstep=lockstep, directory=directory
        ) as run:
            result = run.finish()
        with pytest.raises(GraphError, match='the loop has ended: ask it inside of its `with`'):
            run.finish()
        with pytest.raises(GraphError, match='the loop has ended'):
            run.change(b0=3.0)
        if directory is None:
            with pytest.raises(GraphError, match='the loop has ended'):
                run.result()
    assert (run.result().output == result.output).all()


@pytest.mark.parametrize('lockstep', [True, False])
def test_a_context_that_is_shut_down_ends_the_loop_at_once(lockstep: bool) -> None:
    for when in ('between', 'within'):
        with loop(plant=Tank, rate=50.0, duration=60.0, lockstep=lockstep) as run:
            run.run_until(0.1)
            begin = time.monotonic()
            stop = run.executor.context.shutdown
            if when == 'between':
                stop()
            else:
                run.reference.create_timer(0.01, stop)
            with pytest.raises(GraphError, match=r'context.* was shut down'):
                run.finish()
        assert time.monotonic() - begin < 15.0  # a reader has 30 s to keep up


@pytest.mark.parametrize('depth', [0, -1, 2.0])
def test_a_queue_of_no_sample_is_refused(depth: float) -> None:
    for topic, kind in (('measurement', 'subscription'), ('command', 'publisher')):
        name = f'qos_overrides./x/{topic}.{kind}.depth'
        said = re.escape(f'{name} = {depth}: must be an integer from 1 on')
        given = {name: depth}
        with (
            pytest.raises(SettingError, match=said),
            loop(plant=Tank, controller=given, namespace='x'),
        ):
            pass


class Clashing(Tank):
    """A plant that takes a name which the node has already."""

    def __init__(self, seed: float = 1.0) -> None:
        self.seed = seed


def test_a_coefficient_with_the_name_of_another_parameter_is_refused_by_name() -> None:
    said = r'seed = .*: must be called otherwise'
    with pytest.raises(SettingError, match=said), loop(plant=Clashing):
        pass
