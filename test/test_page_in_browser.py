"""The page of a report in Chromium, where there is one: what it shows, and how readable it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import shutil
from typing import Any

from nadrc_ros.records.history import append_parameters
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.recording import read_samples
from nadrc_ros.report.page import page
import numpy as np
import pytest
from report_helpers import describe, record

sync_api = pytest.importorskip('playwright.sync_api', reason='NOT RUN: playwright is not there')
BROWSER = shutil.which('chromium') or shutil.which('chromium-browser')
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason='NOT RUN: the page in a browser needs chromium, which is not there'
)
LOOK = Path(__file__).with_name('data') / 'look.js'
# What a page may take on a machine that is busy with others [ms].
SOON = 120_000


def seen(runs: Sequence[Path], folder: Path, width: int, dark: bool) -> dict[str, Any]:
    """Return what a script sees that looks at the page of these runs, and what it ``said``."""
    file = folder / 'page.html'
    file.write_text(page(read_runs(runs)), encoding='utf-8')
    said: list[str] = []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=BROWSER, args=['--no-sandbox', '--disable-gpu', '--hide-scrollbars']
        )
        shown = browser.new_page(
            viewport={'width': width, 'height': 900}, color_scheme='dark' if dark else 'light'
        )
        shown.set_default_timeout(SOON)
        shown.on('console', lambda message: said.append(message.text))
        shown.on('pageerror', lambda error: said.append(str(error)))
        shown.goto(file.as_uri())
        shown.wait_for_selector('html[data-ready=yes]', state='attached')
        script = LOOK.read_text(encoding='utf-8')
        found: dict[str, Any] = shown.evaluate(f'() => {{ {script} return look(); }}')
        browser.close()
    return found | {'said': said}


@pytest.mark.parametrize(('width', 'dark'), [(1280, False), (400, True)])
def test_a_page_shows_the_samples_recorded_and_all_of_it_can_be_read(
    width: int, dark: bool, tmp_path: Path
) -> None:
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    append_parameters(run, 1.25, '/mine/controller', {'inner_bandwidth': 55.5})
    found = seen([run], tmp_path, width, dark)
    assert found['said'] == []
    assert found['width'] == width and found['overflow'] <= 0
    # one moment, in all plots
    samples = {
        name: np.array(column, 'f8' if name == 'time' else 'f4')
        for name, column in read_samples(run).items()
    }
    assert found['moment'] == 't = 1.230 s'
    assert float(found['values']['output'].replace('−', '-')) == pytest.approx(
        samples['output'][123], rel=1e-3
    )
    assert found['axes'] == [[1.0, 1.5]] * 5
    # what is shown after a zoom is what was recorded, with one row more on either side
    (shown,) = [[x, y] for name, x, y in found['lines'] if name == 'output']
    assert shown == [samples[name][99:151].tolist() for name in ('time', 'output')]
    (x, y) = next((x, y) for name, x, y in found['lines'] if name == 'command')
    assert x[::2] == samples['time'][99:151].tolist()
    assert y[::2] == samples['command'][99:151].tolist() and y[1::2] == y[:-1:2]
    low, high = found['output_axis']
    inside = samples['output'][100:151]
    assert low < inside.min() and inside.max() < high < inside.max() + 0.3
    # buttons, keys, legend
    assert found['all'] == [0.0, 3.99] and found['keyed'] == pytest.approx(3.99 / 2)
    assert found['hidden'] == 1
    assert found['printed'] == [1000] * 8  # whatever the width of the window
    assert found['dark'] == ('#16191d' if dark else '#ffffff')
    assert found['texts'] > 120
    assert found['faint'] == [] and found['covered'] == []


def test_the_page_of_nine_runs_can_be_read_on_a_telephone(tmp_path: Path) -> None:
    runs = [record(tmp_path / str(k), count=100, seed=k) for k in range(9)]
    for k, run in enumerate(runs):
        describe(run, f'/a_longer_name_{k}', inner_bandwidth=20.0 + k)
    found = seen(runs, tmp_path, 400, dark=False)
    assert found['said'] == [] and found['overflow'] <= 0
    assert found['texts'] > 500
    assert found['faint'] == [] and found['covered'] == []
