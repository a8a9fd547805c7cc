"""The process of `nadrc live`: the node in a thread of its own, the server in the first one."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from errno import EADDRINUSE
import gc
from pathlib import Path
import signal
import socket
import sys
import tempfile
from threading import Event, Thread
import traceback

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.live.access import Access
from nadrc_ros.live.monitor import Monitor
from nadrc_ros.live.search import node_names, once, SILENT
from nadrc_ros.live.server import application
from nadrc_ros.live.session import Session
from nadrc_ros.ros.runtime import BAD_START, init_ros, stop_signals
from nadrc_ros.ros.versions import make_executor, spin_until_over
import rclpy
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets

# What is to be stopped has so long to answer at the end, and the node to end its spin [s].
_LAST_ANSWER, _SPIN = 0.3, 2.0
# What stops a loop may not wait for a thread that predicts [s].
_SWITCH = 1e-3


@attrs.frozen(kw_only=True)
class Asked:
    """What the command line asks for; ``controller`` is empty for the only one there is."""

    controller: str = ''
    namespace: str = ''
    port: int = 8700
    host: str = '127.0.0.1'
    read_only: bool = False


def serve(
    asked: Asked,
    tell: Callable[[str, str], None],
    remark: Callable[[str], None],
    arguments: Sequence[str] = (),
) -> None:
    """
    Serve the page of a loop until a signal asks to stop.

    Parameters
    ----------
    asked
        Which loop, and where.
    tell
        Called with the address and the name of the controller, once the page can be opened.
    remark
        Called with whom the page waits for, if it does for more than a second, and when it ends.
    arguments
        Of the command line, for ROS.

    Raises
    ------
    UserError
        For a port that is taken, several controllers of which none was named, or a bad name.

    """
    sockets, remark = _bind(asked), once(remark)
    sys.setswitchinterval(_SWITCH)
    try:
        init_ros(list(arguments))
        with _signals_stop() as stop:
            namespace, name = node_names(asked.controller, asked.namespace, remark)
            monitor = Monitor(
                namespace=namespace,
                node_name=f'live_{sockets[0].getsockname()[1]}',  # there may be several
                parameters={'controller': name, 'read_only': asked.read_only},
            )
            with _spinning(monitor) as alive:
                gc.collect()
                gc.freeze()

                def over() -> bool:
                    return stop() or not alive()

                asyncio.run(_serve(asked, sockets, monitor, tell, remark, over))
                if not alive():
                    raise UserError('the ROS side of the page failed: see above')
    except BAD_START as error:
        raise UserError(str(error)) from None
    finally:
        for each in sockets:
            each.close()
        rclpy.try_shutdown()


async def _serve(
    asked: Asked,
    sockets: Sequence[socket.socket],
    monitor: Monitor,
    tell: Callable[[str, str], None],
    remark: Callable[[str], None],
    over: Callable[[], bool],
) -> None:
    access = Access(port=sockets[0].getsockname()[1], host=asked.host)
    session = Session(monitor)
    with tempfile.TemporaryDirectory(prefix='nadrc_live_') as reports:
        server = HTTPServer(application(access, session, Path(reports)), max_body_size=4096)
        server.add_sockets(list(sockets))
        tell(access.address, monitor.controller)
        late = asyncio.get_running_loop().time() + SILENT
        while not over():
            await asyncio.sleep(0.05)
            if asyncio.get_running_loop().time() > late:
                remark(monitor.absent or f'{monitor.controller} is there')
        server.stop()
        held = any(client.hold.holding for client in session.clients)
        session.close()
        if held:  # its answer means that the controller has it
            await asyncio.sleep(_LAST_ANSWER)
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(server.close_all_connections(), 1.0)


def _bind(asked: Asked) -> list[socket.socket]:
    try:
        return bind_sockets(asked.port, asked.host)[:1]
    except OSError as error:
        free = '; --port 0 takes a free one' if error.errno == EADDRINUSE else ''
        said = f'cannot listen at {asked.host} port {asked.port}: {error.strerror or error}{free}'
        raise UserError(said) from None


@contextmanager
def _signals_stop() -> Iterator[Callable[[], bool]]:
    """Give what tells whether a signal asked to stop."""
    came = Event()
    before = {n: signal.signal(n, lambda *_: came.set()) for n in stop_signals()}
    try:
        yield came.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _spinning(monitor: Monitor) -> Iterator[Callable[[], bool]]:
    """Spin a node in a thread, and give what tells whether it still does."""
    executor, ended = make_executor(), Event()
    executor.add_node(monitor)

    def spin() -> None:
        try:
            spin_until_over(executor, monitor, ended.is_set)
        except Exception:
            print(traceback.format_exc(), file=sys.stderr)

    thread = Thread(target=spin, name='ros', daemon=True)
    thread.start()
    try:
        yield thread.is_alive
    finally:
        ended.set()
        thread.join(_SPIN)
        if not thread.is_alive():
            executor.shutdown(timeout_sec=0.0)
            monitor.destroy_node()
