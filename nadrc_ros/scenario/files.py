"""Scenario files: read, written, and found by the name of a shipped one."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path
import re
import sys

from nadrc_ros.adrc.errors import did_you_mean, UserError
from nadrc_ros.scenario.mapping import from_mapping, to_mapping
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.user_code import ScenarioError
from nadrc_ros.yaml_text import read_yaml, write_yaml

_PACKAGE = 'nadrc_ros'


def load(path: str | Path) -> Scenario:
    """
    Read a scenario file; a plant file named in it is sought beside it.

    Raises
    ------
    SettingError, ScenarioError
        What is wrong, in one sentence without the name of the file.

    """
    return loads(read_text(path), Path(path).parent)


def loads(text: str, base_dir: str | Path = '.') -> Scenario:
    """
    Return the scenario in a YAML text; a plant file named in it is sought from ``base_dir``.

    Raises
    ------
    SettingError, ScenarioError
        What is wrong, in one sentence.

    """
    try:
        data = read_yaml(text)
    except UserError as error:
        raise ScenarioError(str(error)) from None
    if data is None:
        raise ScenarioError('there is nothing in it: a scenario needs plant and controllers')
    if not isinstance(data, dict):
        kind = 'a list' if isinstance(data, list) else 'a single value'
        raise ScenarioError(f'a scenario is a mapping of keys to values, and this is {kind}')
    return from_mapping(data, base_dir)


def read_text(path: str | Path) -> str:
    """
    Return the text of a scenario file.

    Raises
    ------
    ScenarioError
        Why it cannot be read, in one sentence without the name of the file.

    """
    try:
        return Path(path).read_text(encoding='utf-8')
    except IsADirectoryError:
        raise ScenarioError('this is a directory, not a scenario file') from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f'not UTF-8 text (byte {error.start})') from None
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ScenarioError(f'the file cannot be read: {reason}') from None


def dump(scenario: Scenario) -> str:
    """Return YAML text that loads back to an equal scenario, wherever it is put."""
    return write_yaml(to_mapping(scenario))


def find_scenario(name_or_path: str | Path) -> Path:
    """
    Return the path of a scenario: a file, or one of the shipped ones by its bare name.

    Raises
    ------
    ScenarioError
        When there is neither; lists the shipped names.

    """
    path = Path(name_or_path)
    if path.exists() and not path.is_dir():
        return path
    shipped = shipped_scenarios()
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    if path.is_dir():
        raise ScenarioError('this is a directory, not a scenario file')
    raise ScenarioError(
        'there is no such file, and no shipped scenario of that name: '
        + did_you_mean(str(name_or_path), shipped)
    )


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package, by name."""
    for folder in _config_folders():
        found = {path.stem: path for path in sorted(folder.glob('*.yaml'))}
        if found:
            return found
    return {}


def purpose_of(path: Path) -> str:
    """Return what a scenario is: the first sentence of the comment that its file begins with."""
    lines = read_text(path).splitlines()
    comment = ' '.join(line.lstrip('# ') for line in takewhile(lambda s: s[:1] == '#', lines))
    return re.split(r'(?<!eq)\. ', comment)[0].rstrip('.')


def _config_folders() -> list[Path]:
    """Return where config/ may be: the source tree, a ROS workspace, what pip installed."""
    folders = []
    source = Path(__file__).parents[2]
    if (source / 'package.xml').is_file():
        folders.append(source / 'config')
    try:
        from ament_index_python.packages import get_package_share_directory

        folders.append(Path(get_package_share_directory(_PACKAGE)) / 'config')
    except (ImportError, LookupError, OSError):
        pass  # no ROS here, none that is sourced, or none that knows the package
    folders.append(Path(sys.prefix) / 'share' / _PACKAGE / 'config')
    return folders
