"""The documentation as a site: it builds without a warning, and works without a network."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
import subprocess
import sys
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'docs'))
check: Any = import_module('check')


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site as `make docs` does."""
    folder = tmp_path_factory.mktemp('site')
    options = ['-q', '-W', '-n', '-c', str(ROOT / 'docs'), '-d', str(folder / 'doctrees')]
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', *options, str(ROOT), str(folder / 'html')],
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0 and not done.stderr, done.stderr
    return folder / 'html'


def test_every_page_is_in_the_contents(site: Path) -> None:
    start = (site / 'index.html').read_text(encoding='utf-8')
    for page in (ROOT / 'docs').glob('*.md'):
        assert f'href="docs/{page.stem}.html"' in start, page


def test_every_link_leads_somewhere_and_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    wrong, external = check.problems(site)
    assert not wrong and 'https://semver.org' in external


def test_the_law_is_documented(site: Path) -> None:
    text = (site / 'docs' / 'api.html').read_text(encoding='utf-8')
    for name in ('controller.Controller', 'settings.ControllerSettings', 'law.step'):
        assert f'id="nadrc_ros.adrc.{name}"' in text


def test_what_is_broken_is_found(tmp_path: Path) -> None:
    links = '<a href="gone.html">x</a><a href="#no">y</a><a href="https://e.org">z</a>'
    (tmp_path / 'index.html').write_text(links + '<script src="//e.org/a.js"></script>')
    (tmp_path / 'a.css').write_text('@import "b.css";')
    wrong, external = check.problems(tmp_path)
    assert len(wrong) == 4 and external == {'https://e.org', '//e.org/a.js'}
    assert check.problems(tmp_path / 'nowhere')[0]
