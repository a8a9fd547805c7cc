"""A closed loop of nodes that runs in this process, as far as it is told to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf, isfinite
from numbers import Real
from pathlib import Path
import time
from typing import Any

from nadrc_ros.adrc.errors import did_you_mean, SettingError, UserError
from nadrc_ros.demo.loop_parameters import expected_readers
from nadrc_ros.demo.loop_processes import GraphError
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.records.history import Event, read_history
from nadrc_ros.records.recorded_run import modelled, reached, referred, scheduled
from nadrc_ros.records.recording import JOINED, read_samples, STAMPS
from nadrc_ros.ros.arguments import overrides
from nadrc_ros.ros.lockstep import Lockstep
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.versions import spin_for
from nadrc_ros.simulation.experiment import Retune
from nadrc_ros.simulation.faults import first_period
from nadrc_ros.simulation.simulate import Result
import numpy as np
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future

# How often conditions are looked at [s].
_LOOK = 0.005
# A condition of the graph is waited for so long [s], and the loop so much longer than it runs.
_PATIENCE = 30.0
_SHUT_DOWN = 'the context of the loop was shut down'


def spin_until(
    executor: Executor,
    condition: Callable[[], Any],
    timeout: float = _PATIENCE,
    done: Future | None = None,
) -> Any:
    """
    Run callbacks until ``condition()`` holds, and return it.

    It is looked at every few milliseconds, and when ``done`` completes. The spin itself always has
    a timeout, as an untimed one of the EventsExecutor never ends.

    Raises
    ------
    TimeoutError
        When it does not hold within ``timeout`` [s].

    """
    end = time.monotonic() + timeout
    while not (held := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f'not within {timeout:g} s')
        spin_for(executor, _LOOK, done)
    return held


class RunningLoop:
    """
    Plant, controller, reference and recorder on one executor, and what can be done with them.

    Time is that of the plant: it begins with the first command, and t_k = k / rate. In lockstep it
    stands still while nobody asks for more; in real time it goes on with every spin, and callbacks
    wait while nothing spins.

    Attributes
    ----------
    plant, controller, reference, recorder
        The nodes.
    executor
        Runs them; nodes of one's own can be added with :meth:`add`. Its ``context`` is theirs.
    namespace
        Where they are.
    rate, duration
        Periods per second [Hz], and length of the run [s].

    """

    def __init__(
        self,
        executor: Executor,
        nodes: Mapping[str, Any],
        duration: float,
        retunes: Sequence[Retune] = (),
    ) -> None:
        self.executor = executor
        self.plant: PlantNode = nodes['plant']
        self.controller: ControllerNode = nodes['controller']
        self.reference: ReferenceNode = nodes['reference']
        self.recorder: RecorderNode = nodes['recorder']
        self.namespace: str = self.controller.get_namespace()
        self.rate: float = self.plant.pacing.rate
        self.duration = duration
        self._nodes: dict[str, LiveNode] = dict(nodes)
        self._locked: dict[str, Lockstep] = {
            name: node.lockstep for name, node in nodes.items() if node.lockstep is not None
        }
        self._retunes = sorted(retunes, key=lambda retune: retune.time)
        self._others: list[Node] = []
        self._closed = False
        # Gains b0 of plant and controller, with the times [s] from which they held.
        self._gains: list[list[tuple[float, float]]] = [[], []]
        self._note_gains()

    @property
    def time(self) -> float:
        """Time of the plant [s]."""
        return self.plant.process.k / self.rate

    def add(self, node: Node) -> Any:
        """Run a node of one's own on the same executor; it is destroyed with the loop."""
        self._others.append(node)
        self.executor.add_node(node)
        return node

    def wait_until(
        self,
        condition: Callable[[], Any],
        timeout: float = _PATIENCE,
        done: Future | None = None,
    ) -> Any:
        """
        Run callbacks until ``condition()`` holds, and return it, like :func:`spin_until`.

        Raises
        ------
        TimeoutError
            When it does not hold within ``timeout`` [s] of this machine's time.
        GraphError
            When a node fails, the context was shut down, or the loop has ended.

        """
        self._refuse_ended()

        def look() -> Any:
            self._excuse()
            return condition()

        return self._wait(look, timeout, done)

    def run_until(self, time: float) -> None:
        """
        Go on to the first period at or after ``time`` [s].

        In lockstep all that belongs to the periods before has happened then, and nothing else. In
        real time that moment may be over already.

        Raises
        ------
        SettingError
            For a time after the end, and in lockstep for one that is past.
        TimeoutError, GraphError
            When the loop does not get there.

        """
        self._refuse_ended()
        if not isinstance(time, Real):
            raise SettingError('time', time, 'a number of seconds')
        begin = self.time - 1.0 / self.rate if self._locked else -inf
        if not begin < time <= self.duration:
            raise SettingError('time', time, f'from {self.time:g}, now, to {self.duration:g} s')
        while self._retunes and self._retunes[0].time <= time:
            retune = self._retunes.pop(0)
            self._go_to(first_period(retune.time, self.rate))
            self.change(values=retune.settings)
        self._go_to(first_period(time, self.rate))

    def finish(self) -> Result:
        """
        Run to the end, and return what was recorded.

        Raises
        ------
        UserError
            When the plant diverged: the figures of merit are of the time before, and look good.
            ``run_until(duration)`` and :meth:`result` give what was recorded all the same.
        TimeoutError, GraphError
            When the loop does not get there.

        """
        self.run_until(self.duration)
        self.wait_until(lambda: self._locked or not self.recorder.recording)
        if self.plant.diverged is not None:
            raise UserError(
                f'{self.plant.get_fully_qualified_name()}: the plant diverged at t = '
                f'{self.plant.diverged:.6g} s; the figures of result() are of the time before'
            )
        return self.result()

    def change(
        self, node: str = 'controller', values: Mapping[str, Any] | None = None, **more: Any
    ) -> None:
        """
        Change live parameters of a node, all of them or none, as the service of the node does.

        ``values`` may be nested, and is for names with a dot in them.

        Raises
        ------
        UserError
            With the reason, when they are refused; nothing has changed then. Or for a node that
            there is not.

        """
        self._refuse_ended()
        parameters = overrides({**(values or {}), **more})
        if node not in self._nodes:
            raise UserError(f'there is no node {node}: {did_you_mean(node, self._nodes)}')
        result = self._nodes[node].set_parameters_atomically(parameters)
        if not result.successful:
            raise UserError(result.reason)
        self._note_gains()

    def result(self) -> Result:
        """
        Return what was recorded so far, as ``simulate`` does for the whole of an experiment.

        Rows are by sample of the measurement: in real time a sample that got lost has none.
        """
        columns = {k: np.array(v) for k, v in read_samples(self._written()).items()}
        levels = sorted((k for k in columns if k.startswith('level_')), key=lambda k: int(k[6:]))
        disturbances = np.column_stack([columns.pop(level) for level in levels])
        for name in (*STAMPS, *JOINED):  # which a simulation does not have
            columns.pop(name, None)
        late, time = self.plant.process.dead_time, columns['time']
        acted = reached(time, columns['command'], late.delay, late.before)
        truth = referred(time, acted, columns['total_disturbance'], *self._gains)
        settings = [(0.0, self.controller.controller.settings)]
        truth = scheduled(columns, acted, truth, settings)
        columns['total_disturbance'] = modelled(time, columns['output'], truth, settings)
        return Result(
            **columns,
            inner=(),
            modes=(),
            disturbances=disturbances,
            metrics=self.recorder.figures.values(),
            status_counts={
                s.name.lower(): n for s, n in self.controller.controller.counts.items() if n
            },
            measurement_period=self.controller.controller.settings.measurement_period,
        )

    def events(self) -> list[Event]:
        """Return what happened so far: changes of mode, refused parameters, gaps, with times."""
        return read_history(self._written()).events

    def start(self, *, enable: bool) -> None:
        """Wait until every topic of the loop has its readers, and close the loop."""
        if self._locked:
            self._go_to(0)
            self.wait_until(lambda: all(each.started for each in self._locked.values()))
            return
        try:
            self.wait_until(lambda: not self._missing())
        except TimeoutError:
            raise GraphError(
                f'after {_PATIENCE:g} s there is still no {self._missing()}'
            ) from None
        if enable:
            self.controller.enable()

    def close(self) -> None:
        """Send the safe command, end the recording, and take all nodes from the executor."""
        self._closed = True
        last = [node for node in self._nodes.values() if node is not self.controller]
        for node in (self.controller, *last):
            node.close()
        for node in (*self._nodes.values(), *self._others):
            self.executor.remove_node(node)
        for other in self._others:
            other.destroy_node()

    def _wait(self, condition: Callable[[], Any], timeout: float, done: Future | None) -> Any:
        def look() -> Any:
            self._refuse_ended()
            for node in self._nodes.values():
                if node.failure:
                    raise GraphError(f'{node.get_fully_qualified_name()}: {node.failure}')
            return condition()

        try:
            return spin_until(self.executor, look, timeout, done)
        except (ExternalShutdownException, RuntimeError):  # the latter of who publishes just then
            if self.executor.context.ok():
                raise
            raise GraphError(_SHUT_DOWN) from None

    def _refuse_ended(self) -> None:
        if self._closed:
            raise GraphError('the loop has ended: ask it inside of its `with` block')
        if not self.executor.context.ok():
            raise GraphError(_SHUT_DOWN)

    def _written(self) -> Path:
        """Return the folder of the run, with all in it that is known so far."""
        folder = self.recorder.folder.path
        if self._closed and not folder.exists():
            self._refuse_ended()
        if self.recorder.recording:
            self.recorder.flush()
        return folder

    def _excuse(self) -> None:
        """Blame nobody for the time in which the loop stood still, or the caller kept us."""
        for lockstep in self._locked.values():
            lockstep.go_on()

    def _go_to(self, k: int) -> None:
        """Go on to period ``k``, or to the end."""
        end = round(self.duration * self.rate)
        k = min(k, end)
        timeout = _PATIENCE + 3.0 * max(0, k - self.plant.process.k) / self.rate
        if not self._locked:
            self._wait(lambda: self.plant.process.k >= k, timeout, None)
            return
        self._excuse()
        # The reference sends r_k in answer to the measurement before: also that is left for later.
        firings = {name: k if name != 'reference' or k == end else k - 1 for name in self._locked}
        for name in ('controller', 'reference'):
            self._locked[name].go_on(until=firings[name])
        there = Future()

        def look() -> None:
            if all(self._locked[name].fired >= n for name, n in firings.items()):
                there.set_result(None)

        for each in self._locked.values():
            each.on_fired = look
        look()
        self._wait(there.done, timeout, there)

    def _missing(self) -> str:
        """Return what a loop in real time still waits for, empty when it can begin."""
        readers = expected_readers(self.controller.controller.settings, lockstep=False)
        for topic, (writer, names) in readers.items():
            full = f'{self.namespace.rstrip("/")}/{topic}'
            for publisher in self._nodes[writer].publishers:
                matched = publisher.get_subscription_count()
                if publisher.topic_name == full and matched < len(names):
                    return f'reader of {full} beside {matched} of {", ".join(names)}'
        policy = self.controller.controller.policy
        ages = {'measurement': policy.measurement_age, 'reference': policy.reference_age}
        unheard = [name for name, age in ages.items() if not isfinite(age)]
        return f'{" and ".join(unheard)} at the controller' if unheard else ''

    def _note_gains(self) -> None:
        now = self.time if self._gains[0] else -inf
        b0 = self.plant.process.plant.b0, self.controller.get_parameter('b0').value
        for gains, value in zip(self._gains, b0):
            gains.append((now, value))
