"""A running loop with its live page in a browser, for tests."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import json
from pathlib import Path
from typing import Any

from probe import Probe, Processes
import pytest
from rcl_interfaces.msg import ParameterEvent

SAFE = 0.25
# What a test may see of a machine that is busy with others [s].
SOON = 30.0


class Live:
    """A running loop with its page in a browser, and what came of both."""

    def __init__(self, browser: Any, address: str, start: Processes, probe: Probe) -> None:
        self.browser, self.address, self.probe = browser, address, probe
        self.start = start
        self.said: list[str] = []
        self.asked: list[str] = []
        self.frames: Counter[str] = Counter()
        self.changes: list[list[str]] = []
        self.commands = probe.listen('command')
        probe.node.create_subscription(ParameterEvent, '/parameter_events', self._on_change, 100)
        self.page = self.open()

    def open(
        self, width: int = 1280, before: Callable[[Any], Any] = lambda page: None, **options: Any
    ) -> Any:
        """Open the page in a browser window of its own, ``before`` it connects done that."""
        context = self.browser.new_context(viewport={'width': width, 'height': 850}, **options)
        page = context.new_page()
        page.set_default_timeout(1000 * SOON)
        page.on('console', lambda message: self.said.append(message.text))
        page.on('pageerror', lambda error: self.said.append(str(error)))
        page.on('request', lambda request: self.asked.append(request.url))
        page.on('websocket', lambda socket: socket.on('framesent', self._on_frame))
        before(page)
        page.goto(self.address)
        page.wait_for_selector('html[data-ready=yes]', state='attached')
        page.wait_for_selector('#sliders .slider', state='attached')
        page.click('#pause')  # to draw is most of the work
        return page

    def until(self, condition: Callable[[], Any]) -> Any:
        """Let the page and the graph go on until something holds."""

        def turn() -> Any:
            self.page.wait_for_timeout(1)  # the page's events are taken only in its calls
            return condition()

        return self.probe.wait_until(turn, SOON)

    def disabled(self) -> bool:
        """Tell whether the controller sent its safe command, and says that it is disabled."""
        reports = self.probe.said()
        return bool(reports) and reports[-1][2]['enabled'] == 'False'

    def enabled(self) -> bool:
        """Tell whether the controller says that it is enabled."""
        reports = self.probe.said()
        return bool(reports) and reports[-1][2]['enabled'] == 'True'

    def run(self, page: Any = None, hold: bool = False) -> None:
        """Press Run, and wait until the controller runs."""
        page = page or self.page
        page.set_checked('#hold', hold)
        if not self.enabled():
            # to a page that has not heard of the last stop, it runs already
            page.wait_for_selector('#run[aria-pressed=false]')
            page.click('#run')
        self.until(self.enabled)

    def stopped(self) -> None:
        """Wait until the controller is disabled, with the safe command as the last one."""
        self.until(lambda: self.disabled() and self.commands[-1] == SAFE)

    def _on_frame(self, frame: str | bytes) -> None:
        self.frames[json.loads(frame)['do']] += 1

    def _on_change(self, event: ParameterEvent) -> None:
        if event.node.endswith('/controller') and event.changed_parameters:
            self.changes.append([each.name for each in event.changed_parameters])


def take_back(live: Live) -> None:
    if live.page.is_visible('#take'):
        live.page.click('#take')
    live.page.wait_for_selector('#take', state='hidden')


def hide(page: Any) -> None:
    """Do what a browser does; a page of a headless Chromium is never hidden, nor frozen."""
    page.evaluate(
        """() => {
          Object.defineProperty(document, 'visibilityState', { value: 'hidden', writable: true });
          document.dispatchEvent(new Event('visibilitychange'));
          document.visibilityState = 'visible';
        }"""
    )


def freeze(page: Any) -> None:
    """Let no line of the page's scripts run any more."""
    session = page.context.new_cdp_session(page)
    session.send('Debugger.enable')
    session.send('Debugger.pause')


def hold(live: Live, page: Any) -> None:
    """Run by the heartbeat of a page; on a busy machine the first leases may run out."""
    for _ in range(5):
        live.run(page, hold=True)
        live.probe.spin(0.7)  # more than a lease
        if live.enabled():
            return
    pytest.fail('no lease lasted for 0.7 s')


def downloaded(page: Any, button: str) -> Path:
    with page.expect_download() as got:
        page.click(button)
    path = Path(got.value.path())
    assert path.stat().st_size and got.value.suggested_filename.startswith('nadrc-live-')
    return path
