"""Makes a closed loop of nodes in this process, from parameters or from a scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from itertools import count
from numbers import Real
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.demo.loop_parameters import (
    command_timeout,
    node_parameters,
    pacing,
    recorder_parameters,
)
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.loop_settings import LoopSettings
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.runtime import init_ros, private_domain
from nadrc_ros.ros.versions import make_executor
from nadrc_ros.scenario import Scenario
from nadrc_ros.simulation.experiment import Retune
from nadrc_ros.testing.running_loop import RunningLoop
from rclpy.context import Context
from rclpy.executors import Executor

Parameters = Mapping[str, Any]
# Makes an executor, or is one that runs other nodes too.
AnyExecutor: TypeAlias = Callable[..., Executor] | Executor
_MOST_PERIODS = 1e9
# What all nodes of a loop have in common.
_PACING = ('rate', 'pacing', 'steps', 'readers')
_A_PLANT = 'a class with a method derivative, the name of a registered plant, or a file'
_names = count(1)
# Domains and namespaces of the loops that there are.
_taken: set[tuple[int, str]] = set()


@contextmanager
def loop(
    *,
    plant: type[Any] | str | Path | Parameters,
    controller: Parameters | None = None,
    reference: str | Path | Parameters = 'none',
    rate: float = 200.0,
    duration: float = 10.0,
    lockstep: bool = False,
    executor: AnyExecutor = make_executor,
    namespace: str = '',
    directory: str | Path | None = None,
) -> Iterator[RunningLoop]:
    """
    Run the four nodes of a loop in this process, as long as the ``with`` block lasts.

    Parameters
    ----------
    plant
        A class of one's own, the name of a registered plant, a Python file; or parameters of the
        plant node, in which ``plant`` may be a class.
    controller
        Parameters of the controller node. Order and b0 are those of the plant where left out.
    reference
        The name of a signal, a Python or a CSV file with one, or parameters of the reference node.
    rate, duration
        Periods per second [Hz], and length of the run [s].
    lockstep
        Whether each sample waits for the one before, as fast as this machine can and with the
        bits of the simulation; otherwise the nodes run in real time.
    executor
        A class of executors or what else makes one from a ``context``; or the executor of another
        loop, which this one then joins. With its own one the loop has its own context, in the
        private domain of this process: the default context of rclpy is not touched.
    namespace
        Where the nodes are; by default one that no other loop of this process has.
    directory
        Where the recorder makes its folder, which ``nadrc report`` can read; by default
        it goes with the loop.

    Raises
    ------
    SettingError
        For a parameter that is refused; nothing is left behind then.

    """
    given = dict(controller or {})
    values = dict(plant) if isinstance(plant, Mapping) else {'plant': plant}
    signal = dict(reference) if isinstance(reference, Mapping) else {'signal': str(reference)}
    for name, parameters in (('plant', values), ('controller', given), ('reference', signal)):
        _refuse_pacing(name, parameters)
    rate, duration = _number('rate', rate), _number('duration', duration)
    if not 0.5 < rate * duration < _MOST_PERIODS:
        allowed = f'from one period of {rate:g} Hz to {_MOST_PERIODS:g} of them'
        raise SettingError('duration', duration, allowed)
    periods = round(duration * rate)
    steps = periods if lockstep else None
    cls = PlantNode
    named = values.get('plant')
    if isinstance(named, type):
        if not callable(getattr(named, 'derivative', None)):
            raise SettingError('plant', named.__name__, _A_PLANT)
        cls = _node_of(named)
        del values['plant']
    elif isinstance(named, (str, Path)):
        values['plant'] = str(named)
    elif 'plant' in values:
        raise SettingError('plant', named, _A_PLANT)
    with _Maker(executor, namespace, directory) as make:
        # Who reads what a plant sends does not depend on the controller.
        paced = pacing('plant', ControllerSettings(), rate, steps)
        made = make.node(cls, {'command_timeout': command_timeout(rate)} | values | paced)
        model = made.process.plant
        given = {'plant_order': model.order, 'b0': float(model.b0), **given}
        known = {name: given[name] for name in declared(ControllerSettings) if name in given}
        settings = build(ControllerSettings, known)
        asked = {'enabled_at_start': given.get('enabled_at_start', True)}
        enable = build(LoopSettings, asked).enabled_at_start
        given['enabled_at_start'] = enable and lockstep
        recorder = recorder_parameters(settings, make.directory, 0.0 if lockstep else duration)
        recorder['settle_time'] = min(0.1 * duration, (periods - 1) / rate)
        for name, kind, parameters in (
            ('controller', ControllerNode, given),
            ('reference', ReferenceNode, signal),
            ('recorder', RecorderNode, recorder),
        ):
            make.node(kind, parameters | pacing(name, settings, rate, steps))
        yield make.loop(duration, enable=enable)


@contextmanager
def scenario_loop(
    scenario: Scenario,
    name: str,
    *,
    lockstep: bool = False,
    executor: AnyExecutor = make_executor,
    namespace: str = '',
    directory: str | Path | None = None,
) -> Iterator[RunningLoop]:
    """
    Run a scenario with its controller ``name``, retunes included, like :func:`loop`.

    In lockstep the result has the bits of ``scenario.run(name)``.
    """
    kinds = (PlantNode, ReferenceNode, RecorderNode, ControllerNode)
    with _Maker(executor, namespace, directory) as make:
        parameters = node_parameters(scenario, name, make.directory, lockstep)
        for kind in kinds:
            make.node(kind, parameters[kind.default_name])
        yield make.loop(scenario.duration, scenario.retunes, enable=True)


class _Maker(ExitStack):
    """Makes the nodes of one loop, and takes all of them down again."""

    def __init__(
        self, executor: AnyExecutor, namespace: str, directory: str | Path | None
    ) -> None:
        super().__init__()
        self._given = executor
        self._namespace = namespace or f'loop_{next(_names)}'
        self._nodes: dict[str, Any] = {}
        self.directory = Path(directory or self.enter_context(TemporaryDirectory()))

    def __enter__(self) -> _Maker:
        if callable(self._given):
            private_domain()
            context = Context()
            init_ros([], context)
            self.callback(context.try_shutdown)
            self._executor = self._given(context=context)
            self.callback(self._executor.shutdown, timeout_sec=0.0)
        else:
            self._executor = self._given
        self._take()
        return self

    def _take(self) -> None:
        """Refuse the namespace of a loop that is there: each would hear the other's samples."""
        place = self._executor.context.get_domain_id(), self._namespace.strip('/')
        if place in _taken:
            self.close()
            allowed = 'one that no other loop of this process has; left out, it is'
            raise SettingError('namespace', self._namespace, allowed)
        _taken.add(place)
        self.callback(_taken.remove, place)

    def node(self, kind: type[LiveNode], parameters: Parameters) -> Any:
        """Make a node; should the next ones fail, it goes again."""
        node = kind(
            parameters=parameters, namespace=self._namespace, context=self._executor.context
        )
        self._nodes[kind.default_name] = node
        self.callback(node.destroy_node)
        return node

    def loop(
        self, duration: float, retunes: Sequence[Retune] = (), *, enable: bool
    ) -> RunningLoop:
        """Let the nodes that were made run."""
        running = RunningLoop(self._executor, self._nodes, duration, retunes)
        self.callback(running.close)
        for node in self._nodes.values():
            self._executor.add_node(node)
        running.start(enable=enable)
        return running


def _refuse_pacing(name: str, parameters: Parameters) -> None:
    for key in _PACING:
        if key in parameters:
            allowed = 'left out: rate, duration and lockstep of the loop are for all its nodes'
            raise SettingError(f'{name}.{key}', parameters[key], allowed)


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise SettingError(name, value, 'a number')
    return float(value)


def _node_of(plant: type[Any]) -> type[PlantNode]:
    return type('OwnPlantNode', (PlantNode,), {'plant_type': plant})
