"""The live page in Chromium, with the real server, controller and plant."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
import json
import re
import shutil
from typing import Any

import numpy as np
from probe import Probe, Processes
import pytest
from rcl_interfaces.msg import ParameterEvent

sync_api = pytest.importorskip('playwright.sync_api', reason='NOT RUN: playwright is not there')
BROWSER = shutil.which('chromium') or shutil.which('chromium-browser')
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason='NOT RUN: the live page needs chromium, which is not there'
)
RATE, SAFE = 100.0, 0.25
TABS = ('tune', 'all', 'compare', 'log')
# What a test may see of a machine that is busy with others [s].
SOON = 10.0
SLIDERS = ('controller_bandwidth', 'inner_bandwidth', 'outer_bandwidth')
# The page's own view of something, from its modules.
SAMPLES = """async () => {
  const { time, columns, begin, end } = await import('/static/samples.js');
  const from = Math.max(begin, end - 100);
  return { time: [...time.slice(from, end)], y: [...columns.measurement.slice(from, end)] };
}"""
SENT = "async () => (await import('/static/link.js')).sent"
DRAWN = """async () => {
  const { drawn } = await import('/static/plots.js');
  const [first] = drawn;
  const line = first.lines.find(({ name }) => name === 'output').renderer.data_source.data;
  const { left, right } = first.parts.gaps.data_source.data;
  return { x: [...line.x], broken: [...line.y].map((y) => !Number.isFinite(y)), left, right };
}"""


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

    def open(self, width: int = 1280, **options: Any) -> Any:
        """Open the page in a browser window of its own."""
        context = self.browser.new_context(viewport={'width': width, 'height': 850}, **options)
        page = context.new_page()
        page.set_default_timeout(1000 * SOON)
        page.on('console', lambda message: self.said.append(message.text))
        page.on('pageerror', lambda error: self.said.append(str(error)))
        page.on('request', lambda request: self.asked.append(request.url))
        page.on('websocket', lambda socket: socket.on('framesent', self._on_frame))
        page.goto(self.address)
        page.wait_for_selector('html[data-ready=yes]', state='attached')
        page.wait_for_selector('#sliders .slider')
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


@pytest.fixture(scope='module')
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    directory = tmp_path_factory.mktemp('live')
    start = Processes('/live_page', directory)
    try:
        start(
            'controller', safe_command=SAFE, inner_bandwidth=20.0, outer_bandwidth=15.0, rate=RATE
        )
        start('plant', rate=RATE)
        start('reference', signal='sine', rate=RATE)
        server = start.run(
            'server', '-m', 'nadrc_ros.cli', 'live', '--namespace', '/live_page', '--port', '0'
        )
        probe = Probe('/live_page', directory)
        address = re.compile(r'http://\S+')
        probe.wait_until(lambda: address.search(server.said))
        found = address.search(server.said)
        assert found
        with sync_api.sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=BROWSER, args=['--no-sandbox', '--disable-gpu']
            )
            yield Live(browser, found[0], start, probe)
            browser.close()
        probe.close()
    finally:
        start.kill()


@pytest.fixture(autouse=True)
def calm(live: Live) -> Iterator[None]:
    """Begin with a page that has control, and end without a word on the console."""
    live.page.bring_to_front()
    live.page.keyboard.press('Escape')
    yield
    assert live.said == []


def test_the_page_has_each_sample_once_and_in_order(live: Live) -> None:
    heard = live.probe.listen('measurement')
    live.until(lambda: len(heard) > 150)
    found = live.page.evaluate(SAMPLES)
    assert (np.diff(found['time']) > 0.0).all()
    sent = np.array(heard, np.float32).tolist()
    first = sent.index(found['y'][50])
    assert found['y'][50:] == sent[first : first + 50]


def test_nothing_is_asked_of_another_origin(live: Live) -> None:
    origin = live.address.split('/?')[0]
    assert live.asked and all(url.startswith((origin, 'data:')) for url in live.asked)


def test_dragging_sends_nothing_and_enter_sends_all_at_once(live: Live) -> None:
    page, probe = live.page, live.probe
    page.click('#tab-tune')
    before = probe.get('controller', *SLIDERS)
    page.wait_for_timeout(300)  # for what it asks at its start
    live.frames.clear()
    live.changes.clear()
    for name in SLIDERS:
        page.evaluate(
            """(id) => {
              const slider = document.getElementById(id);
              for (let k = 0; k < 100; k++) {
                slider.value = 500 + k;
                slider.dispatchEvent(new Event('input', { bubbles: true }));
              }
            }""",
            f'tune-{name}',
        )
    page.wait_for_timeout(300)
    assert not live.frames.keys() - {'beat'} and live.changes == []
    assert '3 changes pending' in page.inner_text('#count')
    assert probe.get('controller', *SLIDERS) == before
    page.keyboard.press('Enter')
    live.until(lambda: live.changes)
    assert live.frames['apply'] == 1 and sorted(live.changes[0]) == sorted(SLIDERS)
    page.wait_for_selector('#count:text("No change is pending")')
    shown = [float(page.input_value(f'[data-name={name}]')) for name in SLIDERS]
    assert shown == probe.get('controller', *SLIDERS) != before
    page.keyboard.press('Control+z')
    live.until(lambda: len(live.changes) == 2)
    assert probe.get('controller', *SLIDERS) == before
    live.until(lambda: [float(page.input_value(f'[data-name={n}]')) for n in SLIDERS] == before)


def test_a_refused_value_springs_back_with_the_reason_of_the_node(live: Live) -> None:
    page = live.page
    page.click('#tab-tune')
    page.fill('[data-name=b0]', '-1')
    page.keyboard.press('Enter')
    assert 'keeps its sign' in page.inner_text('#refusal')  # locked: not even sent
    live.run()
    page.set_checked('#lock', False)
    page.fill('[data-name=b0]', '-1')
    page.keyboard.press('Enter')
    page.locator('#refusal', has_text='until it is disabled').wait_for()
    assert page.input_value('[data-name=b0]') == '1' and live.probe.get('controller', 'b0') == [
        1.0
    ]
    page.set_checked('#lock', True)
    page.keyboard.press('Escape')


def test_a_change_made_elsewhere_moves_the_slider_and_is_in_the_log(live: Live) -> None:
    page = live.page
    live.probe.set('controller', outer_bandwidth=12.5)
    live.until(lambda: page.input_value('[data-name=outer_bandwidth]') == '12.5')
    page.click('#tab-log')
    assert 'outer_bandwidth' in page.inner_text('#events li:first-child')


def press_space(page: Any) -> None:
    page.keyboard.press('Space')


def in_a_dialog(page: Any) -> None:
    page.click('#help')
    page.wait_for_selector('#dialog[open]')
    page.keyboard.press('Space')


def click_beside_a_dialog(page: Any) -> None:
    page.click('#help')
    page.wait_for_selector('#dialog[open]')
    page.click('#stop')


def in_the_search(page: Any) -> None:
    page.click('#tab-all')
    page.focus('#search')
    page.keyboard.press('Space')


@pytest.mark.parametrize('stop', [press_space, in_a_dialog, click_beside_a_dialog, in_the_search])
def test_p22_stop_stops_from_everywhere(live: Live, stop: Callable[[Any], None]) -> None:
    live.run()
    stop(live.page)
    live.stopped()


@pytest.mark.parametrize('tab', TABS)
def test_p22_space_stops_from_each_tab(live: Live, tab: str) -> None:
    live.run()
    live.page.click(f'#tab-{tab}')
    live.page.keyboard.press('Space')
    live.stopped()
