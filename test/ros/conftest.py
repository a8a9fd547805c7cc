"""Every test process has a ROS domain of its own, on this machine only, before rclpy starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
import os
from pathlib import Path
import signal
import sys
from typing import Any

from nadrc_ros.testing import private_domain
from probe import Probe, Processes
import pytest

pytest.register_assert_rewrite('accounting')
sys.path.append(str(Path(__file__).parents[1]))  # helpers of all tests
_names = count(1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the soak, which takes longest: begun last, it would run on alone."""
    items.sort(key=lambda item: 'test_graph_soak' not in item.nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """Tell what ended a process of the tests: xdist says only that it is gone."""
    if error:
        status = node.gateway._io.popen.wait(10.0)
        print(f'\n{node.gateway.id} ended with {status} (of a signal: its number, negative)')


private_domain()
# A job in the background of a shell inherits SIGINT as ignored, one under nohup SIGHUP.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(scope='session', autouse=True)
def ros_log(tmp_path_factory: pytest.TempPathFactory) -> None:
    os.environ['ROS_LOG_DIR'] = str(tmp_path_factory.mktemp('ros_log'))


@pytest.fixture
def namespace() -> str:
    """Return a namespace that no other test has: what is left of them is not heard."""
    return f'/t{next(_names)}'


@pytest.fixture
def start(namespace: str, tmp_path: Path) -> Iterator[Processes]:
    """Start node processes in the namespace of the test; they are dead when it ends."""
    processes = Processes(namespace, tmp_path)
    yield processes
    processes.kill()


@pytest.fixture
def make_probe(namespace: str, tmp_path: Path) -> Iterator[Callable[..., Probe]]:
    """Make the probe of a test that chooses its executor, or nodes in the same process."""
    probes: list[Probe] = []

    def make(**arguments: object) -> Probe:
        probes.append(Probe(namespace, tmp_path, **arguments))  # type: ignore[arg-type]
        return probes[-1]

    yield make
    for probe in probes:
        probe.close()


@pytest.fixture
def probe(make_probe: Callable[..., Probe]) -> Probe:
    """Return a node beside the nodes under test, to talk to them and listen."""
    return make_probe()
