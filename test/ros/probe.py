"""What the node tests look at the graph with: one probe node, and nodes as real processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.runtime import init_ros
from nadrc_ros.ros.topics import receive, RECORD, SEND
from nadrc_ros.ros.versions import make_executor, spin_for
from nadrc_ros.testing import spin_until
from nadrc_ros.yaml_text import write_yaml
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

ROOT = Path(__file__).parents[2]
PATIENCE = 30.0
END_PATIENCE = 3.0
ASK_AGAIN = 5.0

Values = dict[str, Any]


def parameter_file(path: Path, parameters: Mapping[str, Values]) -> Path:
    """Write a parameter file: values by node name or pattern."""
    content = {node: {'ros__parameters': values} for node, values in parameters.items()}
    path.write_text(write_yaml(content), encoding='utf-8')
    return path


class NodeProcess:
    """One node as a process, with all that it prints."""

    def __init__(self, command: list[str], log: Path) -> None:
        self._log = log
        # ROS from apt is found by it, too
        found = os.pathsep.join(filter(None, (str(ROOT), os.environ.get('PYTHONPATH'))))
        environment = {**os.environ, 'PYTHONPATH': found}
        with log.open('wb') as file:
            self.popen = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        return self._log.read_text(encoding='utf-8', errors='replace')

    @property
    def own_lines(self) -> list[str]:
        """What the node said, without what Fast DDS prints of its own transport."""
        return [line for line in self.said.splitlines() if 'RTPS_TRANSPORT' not in line]

    @property
    def running(self) -> bool:
        return self.popen.poll() is None

    def signal(self, number: int) -> float:
        """Send a signal and return when that was."""
        self.popen.send_signal(number)
        return time.monotonic()

    def end(self, timeout: float = PATIENCE) -> int:
        """Wait for the end and return the exit code."""
        return self.popen.wait(timeout)


class Processes:
    """Starts nodes in one namespace."""

    def __init__(self, namespace: str, directory: Path) -> None:
        self.namespace = namespace
        self.directory = directory
        self._all: list[NodeProcess] = []

    def __call__(
        self,
        node: str,
        *arguments: str,
        namespace: str | None = None,
        file: Path | None = None,
        **parameters: Any,
    ) -> NodeProcess:
        """Run a node with these parameters, or with a parameter file."""
        name = f'{len(self._all)}_{node}'
        if file is None:
            file = parameter_file(self.directory / f'{name}.yaml', {'/**': parameters})
        return self.run(
            name,
            *('-m', f'nadrc_ros.nodes.{node}', '--ros-args'),
            *('-r', f'__ns:={namespace or self.namespace}', '--params-file', str(file)),
            *arguments,
        )

    def run(self, name: str, *arguments: str) -> NodeProcess:
        """Run Python with these arguments."""
        process = NodeProcess([sys.executable, *arguments], self.directory / f'{name}.log')
        self._all.append(process)
        return process

    def kill(self) -> None:
        """End all that still run; peers would look for one that was killed for 20 s."""
        for process in self._all:
            for number in (signal.SIGCONT, signal.SIGINT):
                process.popen.send_signal(number)
        end = time.monotonic() + END_PATIENCE
        for process in self._all:
            with suppress(subprocess.TimeoutExpired):
                process.end(max(0.0, end - time.monotonic()))
            process.popen.kill()
            process.popen.wait()


class Heard(list[float]):
    """The values that came on a topic, with their publication numbers."""

    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[int] = []


class Probe:
    """
    A node that listens, asks and publishes, in the namespace of the test.

    Nodes that are added share its process and its executor, and get ``parameters`` by node name.
    """

    def __init__(
        self,
        namespace: str,
        directory: Path,
        *,
        executor: Callable[[], Executor] = make_executor,
        parameters: Mapping[str, Values] | None = None,
        arguments: tuple[str, ...] = (),
    ) -> None:
        file = parameter_file(
            directory / 'probe.yaml',
            {f'{namespace}/{node}': values for node, values in (parameters or {}).items()}
            | {f'{namespace}/probe': {'nothing': 0}},
        )
        ros = ['--ros-args', '-r', f'__ns:={namespace}', '--params-file', str(file), *arguments]
        init_ros(ros)
        self.namespace = namespace
        self.node = Node('probe')
        self.executor = executor()
        self.executor.add_node(self.node)
        self._added: list[LiveNode] = []
        self._clients: dict[str, Any] = {}
        self.reports: dict[str, list[tuple[bytes, str, dict[str, str]]]] = {}
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, 100)

    def add(self, node: LiveNode) -> Any:
        """Run a node in this process too."""
        self._added.append(node)
        self.executor.add_node(node)
        return node

    def spin(self, seconds: float) -> None:
        spin_for(self.executor, seconds)

    def wait_until(self, condition: Callable[[], Any], timeout: float = PATIENCE) -> Any:
        """Spin until the condition holds and return it; a test never sleeps."""
        return spin_until(self.executor, condition, timeout)

    def end_of(self, process: NodeProcess) -> int:
        """Spin until a process has ended and return its exit code."""
        self.wait_until(lambda: not process.running)
        return process.end()

    def listen(self, topic: str) -> Heard:
        """Return a list that grows with what is published on a topic; nothing is missed."""
        heard = Heard()

        def take(value: float, info: dict[str, Any]) -> None:
            heard.append(value)
            heard.numbers.append(info['publication_sequence_number'])

        receive(self.node, topic, take, RECORD)
        return heard

    def publisher(self, topic: str) -> Callable[[float], None]:
        publisher = self.node.create_publisher(Float64, topic, SEND)
        return lambda value: publisher.publish(Float64(data=value))

    def nodes(self) -> list[str]:
        """Return the names of the nodes in the namespace of the test."""
        there = self.node.get_node_names_and_namespaces()
        return [name for name, namespace in there if namespace == self.namespace]

    def readers(self, topic: str) -> list[str]:
        full = self.node.resolve_topic_name(topic)
        return [info.node_name for info in self.node.get_subscriptions_info_by_topic(full)]

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Call a service and return its answer."""
        return self.call_all([(self.client(kind, service), request)])[0]

    def client(self, kind: Any, service: str) -> Any:
        """Return the client of a service that is there."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        self.wait_until(self._clients[service].service_is_ready)
        return self._clients[service]

    def call_all(self, calls: list[tuple[Any, Any]]) -> list[Any]:
        """
        Send requests to their clients and return the answers.

        Those that are not answered are asked again: Fast DDS drops the answer to a client that a
        busy machine has not made known to the service in time.
        """
        answers: dict[int, Any] = {}

        def all_answered() -> bool:
            futures = {
                i: client.call_async(request)
                for i, (client, request) in enumerate(calls)
                if i not in answers
            }
            again = time.monotonic() + ASK_AGAIN
            while len(answers) < len(calls) and time.monotonic() < again:
                spin_for(self.executor, 0.005)
                answers.update({i: f.result() for i, f in futures.items() if f.done()})
            return len(answers) == len(calls)

        self.wait_until(all_answered)
        return [answers[i] for i in range(len(calls))]

    def enable(self, on: bool = True, node: str = 'controller') -> Any:
        return self.call(SetBool, f'{node}/enable', SetBool.Request(data=on))

    def set_and_go(self, node: str, **values: Any) -> None:
        """Set parameters without waiting for an answer."""
        client = self.node.create_client(SetParameters, f'{node}/set_parameters')
        self.wait_until(client.service_is_ready)
        client.call_async(SetParameters.Request(parameters=parameter_messages(values)))

    def ask_to_enable(self) -> None:
        """Ask without waiting for an answer, of a node whose service was called before."""
        self._clients['controller/enable'].call_async(SetBool.Request(data=True))

    def trigger(self, service: str) -> Any:
        return self.call(Trigger, service, Trigger.Request())

    def set(self, node: str, **values: Any) -> list[str]:
        """Set parameters one by one and return the reasons of refusal, empty where accepted."""
        request = SetParameters.Request(parameters=parameter_messages(values))
        results = self.call(SetParameters, f'{node}/set_parameters', request).results
        return ['' if result.successful else result.reason or 'no reason' for result in results]

    def set_together(self, node: str, **values: Any) -> str:
        request = SetParametersAtomically.Request(parameters=parameter_messages(values))
        service = f'{node}/set_parameters_atomically'
        result = self.call(SetParametersAtomically, service, request).result
        return '' if result.successful else result.reason or 'no reason'

    def get(self, node: str, *names: str) -> list[Any]:
        request = GetParameters.Request(names=names)
        values = self.call(GetParameters, f'{node}/get_parameters', request).values
        return [parameter_value_to_python(value) for value in values]

    def all_parameters(self, node: str) -> Values:
        request = ListParameters.Request()
        names = self.call(ListParameters, f'{node}/list_parameters', request).result.names
        return dict(zip(names, self.get(node, *names)))

    def descriptors(self, node: str, names: list[str]) -> list[Any]:
        request = DescribeParameters.Request(names=names)
        answer = self.call(DescribeParameters, f'{node}/describe_parameters', request)
        return list(answer.descriptors)

    def said(self, node: str = 'controller') -> list[tuple[bytes, str, dict[str, str]]]:
        """Return the reports of a node on /diagnostics: level, message, values."""
        return self.reports.setdefault(f'{self.namespace}/{node}', [])

    def close(self) -> None:
        self.executor.shutdown(timeout_sec=0.0)
        for node in self._added:
            node.close()
            node.destroy_node()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _on_report(self, array: DiagnosticArray) -> None:
        for status in array.status:
            values = {pair.key: pair.value for pair in status.values}
            self.reports.setdefault(status.name, []).append((status.level, status.message, values))


def parameter_messages(values: Values) -> list[Any]:
    made = [
        value if isinstance(value, Parameter) else Parameter(name, value=value)
        for name, value in values.items()
    ]
    return [parameter.to_parameter_msg() for parameter in made]


INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
