"""`nadrc live`: see and tune a running loop in the browser."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
import sys
from typing import Annotated

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import note, say
from nadrc_ros.extras import MissingPackage
import typer


def live(
    controller: Annotated[
        str, typer.Argument(help='The controller node; by default the only one there is.')
    ] = '',
    namespace: Annotated[str, typer.Option(help='Namespace of the loop.')] = '',
    port: Annotated[
        int, typer.Option(min=0, max=65535, help='Port of the page; 0 = any that is free.')
    ] = 8700,
    host: Annotated[
        str, typer.Option(help='Address to listen at; any other than this may be reached.')
    ] = '127.0.0.1',
    read_only: Annotated[
        bool, typer.Option('--read-only', help='Show the loop, and let nothing be changed.')
    ] = False,
    quiet: Annotated[bool, typer.Option('--quiet', hidden=True)] = False,
) -> None:
    """
    Show and tune a running loop on a page in the browser, at the address that this prints.

    It runs beside the controller and reads what that is wired to. The page is for one operator,
    others may watch. It is no emergency stop.

    Example: nadrc live, or nadrc live /arm/controller --port 0.
    """
    with reporting():
        try:
            import rclpy  # noqa: F401
        except ImportError as error:
            raise UserError(
                f'ROS 2 is not here ({error}): source it, or use `make demo`'
            ) from None
        for package in ('tornado', 'bokeh'):
            if find_spec(package) is None:
                raise MissingPackage('nadrc live', package, 'report')
        from nadrc_ros.live.run import Asked, serve

        asked = Asked(
            controller=controller, namespace=namespace, port=port, host=host, read_only=read_only
        )

        remark = (lambda text: None) if quiet else note

        def tell(address: str, name: str) -> None:
            say(f'{name}: {address}')
            if host not in ('127.0.0.1', 'localhost', '::1'):
                note(f'whoever reads this address can reach the loop from the network of {host}')
            remark('until Ctrl-C; the page is no emergency stop')

        serve(asked, tell, remark, sys.argv)
        remark('stopped')


@contextmanager
def pages_of(controllers: Sequence[str]) -> Iterator[None]:
    """
    Serve the page of each controller in a process of its own, and say its address.

    Raises
    ------
    UserError
        When one does not start.

    """
    import signal
    import subprocess

    from nadrc_ros.ros.children import start_child
    from nadrc_ros.ros.runtime import stop_signals_go_to

    command = [sys.executable, '-m', 'nadrc_ros.cli', 'live', '--port', '0', '--quiet']
    pages = [
        start_child([*command, name], stdout=subprocess.PIPE, text=True) for name in controllers
    ]
    try:
        for page in pages:
            assert page.stdout is not None
            if not (address := page.stdout.readline()):
                raise UserError('the live page did not start')
            say(address.strip())
        if pages:
            note('a page is no emergency stop')
        yield
    finally:
        # A second Ctrl-C must not leave servers behind.
        with stop_signals_go_to(signal.SIG_IGN):
            for page in pages:
                page.send_signal(signal.SIGINT)
            for page in pages:
                try:
                    page.communicate(timeout=5.0)
                except subprocess.TimeoutExpired:
                    page.kill()


def wait_for_ctrl_c(what: str = 'the nodes go on') -> None:
    """Let what runs go on until Ctrl-C."""
    import time

    note(f'{what} until Ctrl-C')
    try:
        while True:
            time.sleep(0.2)
    except KeyboardInterrupt:
        note('stopping')
