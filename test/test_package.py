"""The package as colcon and pip see it."""

from __future__ import annotations

from ast import literal_eval
from importlib import import_module
from pathlib import Path
import re
from shutil import copy2
from subprocess import run
import sys
from xml.etree import ElementTree

from nadrc_ros.extras import EXTRAS
import pytest
from setuptools import find_packages

ROOT = Path(__file__).resolve().parents[1]
SETUP = (ROOT / 'setup.py').read_text(encoding='utf-8')
MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()


def test_every_folder_of_modules_is_installed() -> None:
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / 'nadrc_ros').rglob('*.py')}
    installed = find_packages(str(ROOT), include=['nadrc_ros', 'nadrc_ros.*'])
    assert {'.'.join(folder.parts) for folder in folders} == set(installed)


def test_what_a_command_says_to_install_is_what_setup_says() -> None:
    for extra, packages in EXTRAS.items():
        said = re.search(rf"'{extra}': (.*),\n", SETUP)
        assert said is not None
        listed = re.search(rf'^{said[1]} = (.*)$', SETUP, re.MULTILINE)
        assert literal_eval(listed[1] if listed else said[1]) == list(packages)


def test_there_is_one_version() -> None:
    version = MANIFEST.findtext('version')
    assert version == '0.2.0' and version not in SETUP
    asked = [sys.executable, 'setup.py', '--version']
    done = run(asked, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == version
    log = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert re.search(rf'^{re.escape(version)} \(\d{{4}}-\d\d-\d\d\)\n-+$', log, re.MULTILINE)


def test_every_dependency_is_a_key_of_rosdep() -> None:
    rows = (ROOT / 'test' / 'data' / 'rosdep.csv').read_text(encoding='utf-8').splitlines()
    keys = dict(row.split(',') for row in rows if not row.startswith('#'))
    asked = {element.text for element in MANIFEST if element.tag.endswith('depend')}
    assert asked == set(keys)
    python = {key for key, debian in keys.items() if not debian.startswith('ros-')}
    required = re.search(r'install_requires=\[(.*?)\]', SETUP, re.DOTALL)
    assert required is not None
    wanted = set(re.findall(r"'(\w+)'", required[1].lower())) - {'setuptools'}
    assert wanted <= {key.removeprefix('python3-').replace('yaml', 'pyyaml') for key in python}


def test_the_manifest_is_an_ament_python_package() -> None:
    assert MANIFEST.get('format') == '3'
    assert MANIFEST.findtext('name') == 'nadrc_ros'
    assert MANIFEST.findtext('license') == 'Apache-2.0'
    assert MANIFEST.findtext('export/build_type') == 'ament_python'


def test_every_import_of_ros_is_a_dependency() -> None:
    depends = {element.text for element in MANIFEST if element.tag.endswith('depend')}
    imported = {
        name
        for folder in ('nadrc_ros', 'launch')
        for path in (ROOT / folder).rglob('*.py')
        for name in re.findall(
            r'^\s*(?:from|import) '
            r'(rclpy|\w+_msgs|\w+_srvs|rcl_interfaces|ament_index_python|launch|launch_ros)\b',
            path.read_text(encoding='utf-8'),
            re.MULTILINE,
        )
    }
    assert {'rclpy', 'launch', 'launch_ros'} <= imported <= depends


@pytest.mark.parametrize('name', ['controller', 'plant', 'reference', 'recorder'])
def test_every_executable_has_a_main(name: str) -> None:
    assert callable(import_module(f'nadrc_ros.nodes.{name}').main)
    assert callable(getattr(import_module('nadrc_ros.nodes.executables'), name))
    assert (ROOT / 'resource' / 'nadrc_ros').exists()


@pytest.mark.parametrize('name', ['my folder', 'my:folder'])
def test_a_folder_that_colcon_cannot_take_is_refused_at_once(name: str, tmp_path: Path) -> None:
    folder = tmp_path / name
    folder.mkdir()
    copy2(ROOT / 'Makefile', folder)
    done = run(['make', 'demo'], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and not (folder / '.venv').exists()
    assert 'blank or a colon' in done.stderr and len(done.stderr.splitlines()) == 1


def test_every_page_with_a_command_says_once_where_it_is() -> None:
    for page in (ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))):
        text = page.read_text(encoding='utf-8')
        if re.search(r'^nadrc ', text, re.MULTILINE):
            assert text.count('`nadrc` is `.venv/bin/nadrc`') == 1, page
