"""The layers: an import may only point down, and what must stay pure is."""

from __future__ import annotations

import ast
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'nadrc_ros'
LIMIT = 400
KEPT = {'adrc', 'simulation', 'scenario', 'records', 'extras', 'writing', 'yaml_text'}
# Layer -> the layers of this package that it may import.
ARROWS = {
    'adrc': {'adrc'},
    'simulation': {'adrc', 'simulation'},
    'scenario': {'adrc', 'simulation', 'scenario', 'yaml_text'},
    'records': KEPT,
    'report': KEPT | {'report'},
    'tuning': KEPT | {'report', 'tuning'},
}
ABOVE_NODES = {'tuning', 'report', 'testing', 'cli'}
IMPURE = {
    *('rclpy', 'std_msgs', 'std_srvs', 'rcl_interfaces', 'diagnostic_msgs', 'ament_index_python'),
    *('time', 'datetime', 'logging', 'os', 'pathlib', 'io', 'sys', 'random', 'secrets', 'socket'),
    *('threading', 'subprocess', 'asyncio', 'tempfile', 'shutil', 'scipy', 'matplotlib', 'yaml'),
}
LOUD = {'print', 'open', 'input', 'breakpoint', 'exec', 'eval'}
THEORY = 'nadrc_ros.adrc.theory'
FORBIDDEN_AT_START = ('rclpy', 'time', 'logging', 'scipy', 'numba', 'matplotlib', 'yaml', 'typer')


def files(*layers: str) -> list[Path]:
    found = [path for layer in layers for path in sorted((PACKAGE / layer).rglob('*.py'))]
    assert found
    return found


def imports(path: Path) -> set[str]:
    return imports_in(
        path.read_text(encoding='utf-8'), path.relative_to(ROOT).with_suffix('').parts
    )


def imports_in(source: str, package: tuple[str, ...]) -> set[str]:
    """Dotted names that the source imports; `from a import b` counts as a and a.b."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            own = package[: -node.level]
            base = '.'.join(own) if node.level else ''
            module = '.'.join(filter(None, (base, node.module or '')))
            names |= {module, *(f'{module}.{alias.name}' for alias in node.names)}
    return names


def layers_imported(path: Path) -> set[str]:
    parts = [name.split('.') for name in imports(path)]
    inner = {p.stem if p.is_file() else p.name for p in PACKAGE.iterdir()}
    return {p[1] for p in parts if p[0] == 'nadrc_ros' and len(p) > 1 and p[1] in inner}


def name_of(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


@pytest.mark.parametrize('path', files(*ARROWS), ids=name_of)
def test_an_import_only_points_down(path: Path) -> None:
    layer = path.relative_to(PACKAGE).parts[0]
    assert layers_imported(path) <= ARROWS[layer]


def test_nodes_know_nothing_of_what_is_asked_of_the_law() -> None:
    for path in sorted((PACKAGE / 'nodes').rglob('*.py')):
        assert not layers_imported(path) & ABOVE_NODES, path
    for path in files('testing'):
        assert 'cli' not in layers_imported(path), path
    for layer in ('paper', 'tuning', 'report'):
        for path in sorted((PACKAGE / layer).rglob('*.py')):
            assert 'nodes' not in layers_imported(path), path
            assert not {name.split('.')[0] for name in imports(path)} & {'rclpy'}, path


@pytest.mark.parametrize('path', files('adrc', 'simulation'), ids=name_of)
def test_the_law_and_the_simulation_are_pure(path: Path) -> None:
    tops = {name.split('.')[0] for name in imports(path)}
    assert not tops & (IMPURE - ({'scipy'} if is_theory(path) else set()))
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    called = {node.func.id for node in calls if isinstance(node.func, ast.Name)}
    assert not called & LOUD


def is_theory(path: Path) -> bool:
    return path.is_relative_to(PACKAGE / 'adrc' / 'theory')


def test_numpy_and_scipy_stay_out_of_the_law_and_in_its_theory() -> None:
    theory = [path for path in files('adrc') if is_theory(path)]
    assert len(theory) > 5
    for path in set(files('adrc')) - set(theory):
        assert not {name.split('.')[0] for name in imports(path)} & {'numpy', 'scipy'}, path


def test_nothing_that_a_node_may_import_imports_the_theory() -> None:
    for path in sorted(PACKAGE.rglob('*.py')):
        above = path.relative_to(PACKAGE).parts[0].removesuffix('.py') in ABOVE_NODES
        if not above and not is_theory(path):
            assert not any(f'{name}.'.startswith(f'{THEORY}.') for name in imports(path)), path


def test_numba_is_named_in_one_file_only() -> None:
    using = [
        path
        for path in sorted(PACKAGE.rglob('*.py'))
        if any(name.split('.')[0] == 'numba' for name in imports(path))
    ]
    assert len(using) <= 1
    assert all(path.parent == PACKAGE / 'simulation' for path in using)


def modules_after(code: str) -> set[str]:
    script = f'import sys\nbefore = set(sys.modules)\n{code}\nprint(*(set(sys.modules) - before))'
    done = subprocess.run(
        [sys.executable, '-S', '-c', f'import sys; sys.path[:] = {sys.path!r}\n{script}'],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    return {name.split('.')[0] for name in done.stdout.split()}


def test_importing_the_law_loads_nothing_heavy() -> None:
    loaded = modules_after('import nadrc_ros.adrc.controller')
    assert 'nadrc_ros' in loaded and 'attrs' in loaded
    assert not loaded & {*FORBIDDEN_AT_START, 'numpy'}


def test_importing_the_simulation_loads_neither_ros_nor_scipy_nor_numba() -> None:
    code = 'import nadrc_ros.simulation, nadrc_ros.simulation.plants, nadrc_ros.simulation.noise'
    loaded = modules_after(code)
    assert 'numpy' in loaded
    assert not loaded & {'rclpy', 'scipy', 'numba', 'matplotlib', 'typer'}


def test_no_file_is_longer_than_it_may_be() -> None:
    for folder in ('nadrc_ros', 'test', 'bench'):
        for path in sorted((ROOT / folder).rglob('*.py')):
            assert len(path.read_text(encoding='utf-8').splitlines()) <= LIMIT, path


def test_the_scan_sees_imports_of_every_form() -> None:
    source = 'import os.path\nfrom time import sleep\ndef f():\n    from nadrc_ros import cli\n'
    names = imports_in(source + 'from ..nodes import plant', ('nadrc_ros', 'adrc', 'law'))
    assert {'os.path', 'time', 'time.sleep', 'nadrc_ros.cli', 'nadrc_ros.nodes.plant'} <= names
