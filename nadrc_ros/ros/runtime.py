"""How a process of this package starts ROS, spins its nodes and ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import fcntl
from functools import partial
import gc
import os
from pathlib import Path
import signal
import sys
import tempfile
import time
import traceback
from typing import Any, IO

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.ros.arguments import refuse_malformed, rules_of, tell_unused
from nadrc_ros.ros.children import end_with_parent
from nadrc_ros.ros.command_line import About, NodeParser
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.versions import choose_transport, make_executor, spin_for, spin_until_over
from nadrc_ros.terminal import columns, wrapped
import rclpy
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

# The ramp to the safe command may take so long [s].
_STOP_TIME = 0.5
# The least life of a writer after its last message, for readers that do not acknowledge.
LAST_WAIT = 0.1
DESTROY_TIME = 0.2
# From the signal to the end, where there is more to destroy; promised is 1 s.
END_TIME = 0.8
TEAR_DOWN_TIME = 2.0
# Exit code, as subprocess gives it, of a node that had done all and then locked up.
LOCKED_UP = -signal.SIGALRM
# RuntimeError is what rclpy makes of a malformed --params-file or --ros-args.
BAD_START = (UserError, ParameterException, OSError, RuntimeError)
# Above 101 the ports of a domain can be those that Linux gives to others.
_DOMAINS = range(1, 101)
# Open files hold the locks: of the domain that this process took, once it did.
_taken: dict[int, IO[str]] = {}


def private_domain(*, keep: bool = False) -> int:
    """
    Give this process, and those it starts, a ROS domain that no other process has.

    It sets ``ROS_DOMAIN_ID`` and ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` in the environment,
    so it has to come before rclpy is initialised. A locked file stands for each domain and frees
    it with the process. Asked again, it gives the same domain.

    Parameters
    ----------
    keep
        Whether a domain that the environment already names is used as it is.

    Raises
    ------
    UserError
        When all domains are taken.

    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    if keep and 'ROS_DOMAIN_ID' in os.environ:
        return int(os.environ['ROS_DOMAIN_ID'])
    domain = next(iter(_taken), 0) or _take_domain()
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    return domain


def _take_domain() -> int:
    for domain in _DOMAINS:
        path = Path(tempfile.gettempdir(), f'nadrc_ros_domain_{domain}.lock')
        with suppress(OSError):  # another user's: who may read it may lock it too
            path.touch()
        try:
            lock = path.open()
        except OSError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        _taken[domain] = lock
        return domain
    raise UserError(f'all ROS domains from {_DOMAINS[0]} to {_DOMAINS[-1]} are taken')


def stop_signals() -> list[int]:
    """
    Return the signals that ask for an orderly stop: Ctrl-C, termination, the end of the terminal.

    The last of them is left out where it is ignored, for which one starts a process with `nohup`.
    """
    ends: list[int] = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        ends.append(signal.SIGHUP)
    return ends


@contextmanager
def stop_signals_go_to(handler: Callable[[int, Any], Any] | signal.Handlers) -> Iterator[None]:
    """Let another handler have the signals that ask for a stop."""
    numbers = stop_signals()
    before = [signal.signal(number, handler) for number in numbers]
    try:
        yield
    finally:
        for number, earlier in zip(numbers, before):
            signal.signal(number, earlier)


def init_ros(arguments: list[str] | None = None, context: Context | None = None) -> None:
    """
    Start ROS with signals left to us, over UDP unless the environment says otherwise.

    A process that was started by a command of this package ends when that is killed.
    """
    end_with_parent()
    choose_transport()
    arguments = list(sys.argv if arguments is None else arguments)
    if complaint := _no_log_file():
        arguments += ['--ros-args', '--disable-external-lib-logs']
    rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
    if complaint:
        get_logger('nadrc_ros').warning(complaint)


def _no_log_file() -> str:
    """Return why ROS can write no log file, without which it would not start; empty if it can."""
    home = os.environ.get('ROS_HOME') or os.path.join('~', '.ros')
    folder = os.environ.get('ROS_LOG_DIR') or os.path.join(home, 'log')
    remedy = 'the log goes to the console only, unless ROS_LOG_DIR names a folder to write to'
    if folder.startswith('~') and not os.environ.get('HOME'):
        return f'there is no HOME: {remedy}'
    try:
        os.makedirs(folder := os.path.expanduser(folder), exist_ok=True)
    except OSError as error:
        return f'{folder}: {error.strerror}: {remedy}'
    return '' if os.access(folder, os.W_OK | os.X_OK) else f'{folder}: not writable: {remedy}'


def run_command(kind: type[LiveNode], about: About) -> int:
    """Run one node of a kind as its executable does, and return the exit code."""
    NodeParser(kind.default_name, about).parse(sys.argv)
    return run(lambda: kind(arguments=sys.argv))


def run(make: Callable[[], LiveNode | Sequence[LiveNode]]) -> int:
    """
    Run a node, or several, until told to stop; return the exit code of the process.

    All go on until the last one has finished, and all end with the first one that fails: nodes of
    one process have one fate. rclpy's own signal handlers invalidate the context at once, and a
    last safe command could not be sent; the ones here only raise a flag, also for a second signal
    while stopping.
    """
    signals: list[int] = []
    nodes: list[LiveNode] = []

    def on_signal(number: int, _: object) -> None:
        signals.append(number)
        LiveNode.told_to_stop = True

    for number in stop_signals():
        signal.signal(number, on_signal)
    try:
        refuse_malformed(sys.argv)
        init_ros()
        made = make()
        nodes += [made] if isinstance(made, LiveNode) else made
        tell_unused(nodes, rules_of(sys.argv))
    except BAD_START as error:
        text = f'error: cannot start: {error}'
        print(wrapped(text, columns(sys.stderr)), file=sys.stderr)
        rclpy.try_shutdown()
        return 0 if signals else 1
    executor = make_executor()
    for node in nodes:
        executor.add_node(node)
    _become_realtime(nodes)
    gc.collect()
    gc.freeze()  # a full collection in mid-run would stop the loop for milliseconds
    code = 0
    try:
        spin_until_over(executor, nodes[0], lambda: signals or _over(nodes))
        end = _begin_stop(nodes)
        ramped = time.monotonic() + _STOP_TIME
        while not all(node.stopped for node in nodes) and time.monotonic() < ramped:
            spin_for(executor, 0.01)
    except Exception:
        nodes[0].get_logger().fatal('stopping after an error:\n' + traceback.format_exc())
        code = 1
        end = _begin_stop(nodes)
    endings: list[Callable[[], None]] = [node.close for node in nodes]
    endings.append(partial(_await_delivery, nodes, end))
    for last in endings:
        try:
            last()
        except Exception:  # the others must be closed all the same
            nodes[0].get_logger().fatal('while stopping:\n' + traceback.format_exc())
            code = 1
    code = 1 if any(node.failure for node in nodes) else code
    _tear_down(executor, nodes, code, end)
    return code


def _over(nodes: Sequence[LiveNode]) -> bool:
    return any(node.failure for node in nodes) or all(node.finished for node in nodes)


def _become_realtime(nodes: Sequence[LiveNode]) -> None:
    """Ask for real-time priority if a node wants it; say in one line what came of it."""
    asking = [node for node in nodes if node.pacing.realtime]
    if not asking:
        return
    from nadrc_ros.ros.realtime import become_realtime

    obtained, said = become_realtime()
    logger = asking[0].get_logger()
    (logger.info if obtained else logger.warning)(f'realtime: {said}')
    for node in nodes:
        node.scheduling = said


def _begin_stop(nodes: Sequence[LiveNode]) -> float:
    """Let all nodes begin to stop, and return when the process should have ended."""
    for node in nodes:
        node.begin_stop()
    return time.monotonic() + END_TIME


def _await_delivery(nodes: Sequence[LiveNode], end: float) -> None:
    """
    Keep the writers until all is acknowledged, or for as long as there is time.

    A reader that was held up can hear first that a writer is gone, and drops then what waits from
    it. With lockstep's queues Fast DDS asks for acknowledgement only every 3 s.
    """
    least = time.monotonic() + LAST_WAIT
    end = max(least, end - DESTROY_TIME)
    for node in nodes:
        node.await_delivery(max(0.0, end - time.monotonic()))
    time.sleep(max(0.0, least - time.monotonic()))


def _tear_down(executor: Executor, nodes: Sequence[LiveNode], code: int, end: float) -> None:
    """
    Destroy what the middleware holds; all that matters is sent and written by now.

    Fast DDS 2.14 can lock up in that, with the GIL held, when peers go at the same moment. The
    process ends then all the same, by SIGALRM, which needs no GIL and looks like no failure of
    ours. And of many nodes it destroys thousands of parts one by one: what is left at ``end`` goes
    with the process, which peers notice late, and its shared memory stays.
    """
    # Python gives a handler up on its way out, and one more signal would then end the process.
    for number in stop_signals():
        signal.signal(number, signal.SIG_IGN)
    end = max(end, time.monotonic() + DESTROY_TIME)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, TEAR_DOWN_TIME)
    executor.shutdown(timeout_sec=0.0)
    for node in nodes:
        if time.monotonic() > end:
            os._exit(code)
        node.destroy_node()
    rclpy.try_shutdown()
    signal.setitimer(signal.ITIMER_REAL, 0.0)
