"""The live page in Chromium, with the real server, controller and plant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import json
from pathlib import Path
import re
import shutil
from typing import Any

from live_browser import downloaded, freeze, hide, hold, Live, SAFE, take_back
from live_loop import STAYS
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recorded_run import window
from nadrc_ros.report.canvas import WHITE
from nadrc_ros.report.roles import COLOURS
import numpy as np
from PIL import Image, ImageColor
from probe import Probe, Processes
import pytest

sync_api = pytest.importorskip('playwright.sync_api', reason='NOT RUN: playwright is not there')
BROWSER = shutil.which('chromium') or shutil.which('chromium-browser')
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason='NOT RUN: the live page needs chromium, which is not there'
)
RATE = 100.0
TABS = ('tune', 'all', 'compare', 'log', 'faults')
SLIDERS = ('controller_bandwidth', 'inner_bandwidth', 'outer_bandwidth')
# The page's own view of something, from its modules.
SAMPLES = """async () => {
  const { time, columns, begin, end } = await import('/static/samples.js');
  const from = Math.max(begin, end - 100);
  return { time: [...time.slice(from, end)], y: [...columns.measurement.slice(from, end)] };
}"""
NEWEST = "async () => (await import('/static/samples.js')).latest()"
PIN = """async ([from, to]) => {
  const { ask } = await import('/static/link.js');
  return (await ask({ do: 'pin', from, to })).ok;
}"""
# The next comparison, and what the table has of it.
COMPARED = """async () => {
  const { on } = await import('/static/link.js');
  const told = await new Promise((done) => on('comparison', (each) => setTimeout(done, 0, each)));
  const rows = [...document.querySelectorAll('#figures tbody tr')];
  const cells = rows.map((row) => [...row.querySelectorAll('td')].map((each) => each.textContent));
  const names = Object.keys(told.before.figures);
  return [told, Object.fromEntries(names.map((name, i) => [name, cells[i]]))];
}"""
DRAWN = """async () => {
  const { drawn } = await import('/static/plots.js');
  const [first] = drawn;
  const { x, y } = first.lines.find(({ name }) => name === 'y').renderer.data_source.data;
  const { left, right } = first.parts.gaps.data_source.data;
  return { x: [...x].filter((_, i) => Number.isFinite([...y][i])), left, right };
}"""
HTML = '<img src=x onerror=console.log("run")>'


@pytest.fixture(scope='module')
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    directory = tmp_path_factory.mktemp('live')
    start = Processes('/live_page', directory)
    try:
        start(
            'controller', safe_command=SAFE, inner_bandwidth=20.0, outer_bandwidth=15.0, rate=RATE
        )
        start('plant', rate=RATE, **STAYS)
        start('reference', signal='square', frequency=1.0, rate=RATE)
        start('recorder', directory=str(directory / 'runs'), rate=RATE)
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
    last = found['y'][-1]
    live.until(lambda: last in np.array(heard, np.float32))
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


@pytest.fixture
def narrow(live: Live) -> Iterator[Any]:
    """Open the page on a telephone that has control; it is closed, and control is back."""
    page = live.open(400, has_touch=True, color_scheme='dark')
    page.click('#take')
    page.wait_for_selector('#take', state='hidden')
    yield page
    page.context.close()
    take_back(live)


def test_on_a_telephone_nothing_is_too_wide_and_a_tap_stops(live: Live, narrow: Any) -> None:
    live.run(narrow)
    for tab in ('plots', *TABS):
        narrow.tap(f'#tab-{tab}')
        assert narrow.evaluate('document.documentElement.scrollWidth <= innerWidth')
        box = narrow.locator('#stop').bounding_box()
        assert box['width'] == 400 and box['y'] + box['height'] == 850
    narrow.tap('#tab-compare')
    narrow.tap('#save')
    narrow.wait_for_selector('#dialog[open]')
    narrow.tap('#stop')
    live.stopped()


def test_p21_who_takes_over_has_the_loop_and_who_loses_the_page_loses_it(live: Live) -> None:
    page = live.open()
    assert page.is_disabled('#run') and page.is_disabled('[data-name=b0]')
    assert 'Another page has control' in page.inner_text('#banner')
    page.click('#take')
    page.wait_for_selector('#banner', state='hidden')
    assert page.is_enabled('[data-name=b0]')
    live.page.wait_for_selector('#take')
    assert live.page.is_disabled('#run')
    live.page.click('#tab-log')
    live.page.locator('#events [data-kind=control]').first.wait_for()
    page.keyboard.press('Space')
    live.stopped()
    for lose in (hide, freeze):
        hold(live, page)
        lose(page)
        live.stopped()
    page.context.close()
    page = live.open()  # enables nothing by itself
    live.probe.spin(0.3)
    assert live.disabled()
    page.click('#take')
    page.wait_for_selector('#take', state='hidden')
    hold(live, page)
    page.context.close()
    live.stopped()
    take_back(live)


def test_p21_a_loop_that_runs_by_itself_is_held_from_the_tick_on(live: Live) -> None:
    page = live.open()
    page.click('#take')
    page.wait_for_selector('#take', state='hidden')
    for _ in range(5):  # on a busy machine the lease may run out before it is given back
        live.run(page, hold=True)
        page.set_checked('#hold', False)
        live.probe.spin(0.7)  # more than a lease
        if live.enabled():
            break
    else:
        pytest.fail('without the tick it is held all the same')
    page.set_checked('#hold', True)
    live.until(lambda: page.inner_text('#lease').startswith('yes') or live.disabled())
    page.context.close()
    live.stopped()
    take_back(live)


def test_a_silent_sensor_breaks_the_line_and_says_why(live: Live) -> None:
    page = live.page
    live.run()
    page.click('#pause')
    page.click('#tab-faults')
    page.click('[data-fault=silent]')
    page.wait_for_selector('#state[data-state=safe]')
    assert 'no valid measurement' in page.inner_text('#why')
    page.click('[data-fault=silent]')
    page.wait_for_selector('#state[data-state=in-control]')
    page.click('#tab-log')
    page.locator('#events [data-kind=gap] .text', has_text='measurement').first.wait_for()
    live.until(lambda: page.evaluate(DRAWN)['left'])
    drawn = page.evaluate(DRAWN)
    widest = max(zip(drawn['left'], drawn['right']), key=lambda span: span[1] - span[0])
    inside = [x for x in drawn['x'] if widest[0] + 0.02 < x < widest[1] - 0.02]
    assert widest[1] - widest[0] > 0.3 and inside == []
    page.click('#pause')


def test_what_is_saved_is_what_is_shown(live: Live) -> None:
    live.until(lambda: live.page.evaluate(SAMPLES)['time'][0] > 0.0)
    live.page.click('#pause')  # to what is there by now
    live.page.click('#pause')
    lines = downloaded(live.page, '#csv').read_text(encoding='utf-8').splitlines()
    names, rows = lines[0].split(','), [line.split(',') for line in lines[1:]]
    assert names[0] == 'time [s]' and {len(row) for row in rows} == {len(names)}
    y = {row[0]: np.float32(row[names.index('measurement')] or 'nan') for row in rows}
    shown = live.page.evaluate(SAMPLES)
    known = {f'{t:.6f}': np.float32(v) for t, v in zip(shown['time'], shown['y'])}
    both = known.keys() & y.keys()
    saved, drawn = [y[t] for t in both], [known[t] for t in both]
    assert len(both) > 20 and np.array_equal(saved, drawn, equal_nan=True)
    picture = Image.open(downloaded(live.page, '#png')).convert('RGB')
    assert picture.width > 400 and picture.height > 600
    assert {ImageColor.getrgb(each) for each in (COLOURS[0], WHITE)} <= {
        color for _, color in picture.getcolors(1 << 24) or []
    }


@pytest.mark.realtime
def test_the_table_has_the_figures_of_the_report(live: Live) -> None:
    page = live.page
    live.run()
    page.click('#tab-compare')
    live.until(lambda: page.evaluate(NEWEST) > 0.0)
    begin = page.evaluate(NEWEST)
    live.until(lambda: page.evaluate(NEWEST) > begin + 2.0)
    assert page.evaluate(PIN, [begin + 1.005, begin + 2.005])  # between rows
    page.locator('#comparable', has_text='Over the same stretch').wait_for()
    told, cells = page.evaluate(COMPARED)
    shown = page.evaluate(SAMPLES)
    folder = Path(live.probe.trigger('recorder/save').message)
    live.until(lambda: read_run(folder).columns['measurement'].size > 300)
    page.click('#report')
    page.wait_for_selector('#dialog a', timeout=120_000)  # as long as a report may take
    with page.context.expect_page() as opened:
        page.click('#dialog a')
    opened.value.locator('h1').first.wait_for()
    opened.value.close()
    run = read_run(folder)
    measured = run.columns['measurement'].astype(np.float32)
    place = int(np.flatnonzero(measured == np.float32(shown['y'][0]))[0])
    offset = shown['time'][0] - run.time[place]
    for column, part in enumerate(('before', 'after')):
        stretch = window(run, told[part]['from'] - offset, told[part]['to'] - offset)
        for name, value in stretch.metrics.as_dict().items():
            cell = cells[name][column].replace('−', '-')
            assert (
                (cell == '–') if value is None else float(cell) == pytest.approx(value, rel=5.1e-4)
            ), (name, part)


def test_markup_in_names_and_lines_is_shown_as_text(live: Live) -> None:
    parameter = {
        'name': HTML, 'text': HTML, 'unit': HTML, 'value': HTML, 'kind': 'text', 'live': True,
        'low': None, 'high': None, 'default': None, 'choices': [], 'group': 'other',
    }  # fmt: skip
    hello = {
        'type': 'hello', 'protocol': 1, 'node': HTML, 't': 0.0, 'rate': 100.0, 'operator': True,
        'read_only': False, 'simulated': False, 'hold_to_run': True, 'signals': [], 'faults': [],
        'parameters': [parameter],
    }  # fmt: skip
    event = {'type': 'event', 't': 1.0, 'node': HTML, 'kind': HTML, 'text': HTML}

    def answer(socket: Any) -> None:
        for message in (hello, event):
            socket.send(json.dumps(message))

    context = live.browser.new_context()
    page = context.new_page()
    page.on('console', lambda message: live.said.append(message.text))
    page.route_web_socket(re.compile('/ws$'), answer)
    page.goto(live.address)
    page.click('#tab-log')
    page.locator('#events', has_text=HTML).wait_for()
    page.click('#tab-all')
    page.locator('#list', has_text=HTML).wait_for()
    assert page.inner_text('#node') == HTML and page.locator('img').count() == 0
    context.close()


def test_no_rule_of_accessibility_is_broken(live: Live) -> None:
    axe = pytest.importorskip('axe_playwright_python.sync_playwright', reason='NOT RUN: no axe')
    page = live.page
    page.evaluate(axe.Axe().axe_script)
    for scheme, tab, part in (
        *(('light', 'tune', 'html'), ('dark', 'tune', 'html'), ('dark', 'all', '#search')),
        *(('dark', tab, f'#{tab}') for tab in ('compare', 'faults', 'log')),
    ):
        page.emulate_media(color_scheme=scheme)
        page.click(f'#tab-{tab}')
        found = page.evaluate(f'axe.run("{part}")')['violations']
        assert [(each['id'], [n['html'] for n in each['nodes']]) for each in found] == [], tab
