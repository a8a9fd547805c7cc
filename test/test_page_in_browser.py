"""The page of a report in Chromium, where there is one: what it shows, and how readable it is."""

from __future__ import annotations

from collections.abc import Sequence
from html import unescape
import json
from pathlib import Path
import re
import shutil
import subprocess
from typing import Any

from nadrc_ros.records.history import append_parameters
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.recording import read_samples
from nadrc_ros.report.page import page
import numpy as np
import pytest
from report_helpers import describe, record

BROWSER = shutil.which('chromium') or shutil.which('chromium-browser')
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason='NOT RUN: the page in a browser needs chromium, which is not there'
)
# Before all other scripts: nothing may be said on the console.
LISTEN = """<script>
const said = [];
for (const kind of ['log', 'info', 'warn', 'error']) {
  console[kind] = (...all) => said.push(all.join());
}
addEventListener('error', (event) => said.push(event.message));
addEventListener('unhandledrejection', (event) => said.push(String(event.reason)));
</script>"""
# A window of Chromium is never as narrow as a telephone.
FRAME = """<!DOCTYPE html>
<iframe src="page.html" style="width:{}px;height:900px;border:0"></iframe>
<pre id="result"></pre><script>
addEventListener('message', ({{ data }}) => {{ result.textContent = data; }});
</script>"""
LOOK = Path(__file__).with_name('data') / 'look.js'


def seen(runs: Sequence[Path], folder: Path, width: int, dark: bool) -> dict[str, Any]:
    """Return what a script sees that looks at the page of these runs."""
    text = page(read_runs(runs))
    look = f'<script>{LOOK.read_text(encoding="utf-8")}</script></body>'
    text = text.replace('<head>', f'<head>{LISTEN}', 1).replace('</body>', look, 1)
    (folder / 'page.html').write_text(text, encoding='utf-8')
    (folder / 'frame.html').write_text(FRAME.format(width))
    done = subprocess.run(
        [
            *(str(BROWSER), '--headless', '--no-sandbox', '--disable-gpu', '--dump-dom'),
            *('--window-size=1400,1000', '--hide-scrollbars', '--virtual-time-budget=30000'),
            *(f'--blink-settings=preferredColorScheme={0 if dark else 1}',),
            *(f'--user-data-dir={folder / "profile"}', (folder / 'frame.html').as_uri()),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = re.search(r'<pre id="result">(.+?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr[-2000:]
    result = json.loads(unescape(found[1]))
    assert isinstance(result, dict) and 'failed' not in result, result
    return result


@pytest.mark.parametrize(('width', 'dark'), [(1280, False), (400, True)])
def test_a_page_shows_the_samples_recorded_and_all_of_it_can_be_read(
    width: int, dark: bool, tmp_path: Path
) -> None:
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    append_parameters(run, 1.25, '/mine/controller', {'inner_bandwidth': 55.5})
    found = seen([run], tmp_path, width, dark)
    assert found['ready'] == 'yes' and found['said'] == []
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
    assert found['ready'] == 'yes' and found['said'] == [] and found['overflow'] <= 0
    assert found['texts'] > 500
    assert found['faint'] == [] and found['covered'] == []
