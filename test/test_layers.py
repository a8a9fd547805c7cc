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
FILES = {'atomic', 'extras', 'parameter_file', 'terminal', 'yaml_text'}
# Floor -> the floors of this package that it may import from; FILES are for all but the first two.
ARROWS = {
    'adrc': set(),
    'simulation': {'adrc'},
    'theory': {'adrc'},
    'export': {'adrc', 'theory'},
    'wiring': {'adrc'},
    'scenario': {'adrc', 'simulation'},
    'records': {'adrc', 'simulation', 'scenario', 'wiring'},
    'report': {'adrc', 'simulation', 'scenario', 'records'},
    'tuning': {'adrc', 'simulation', 'scenario', 'records', 'report', 'theory'},
    'ros': {'adrc', 'simulation', 'scenario', 'wiring'},
    'nodes': {'adrc', 'simulation', 'scenario', 'records', 'ros', 'wiring'},
    'demo': {'adrc', 'simulation', 'scenario', 'records', 'ros', 'nodes'},
    'live': {
        *('adrc', 'simulation', 'scenario', 'records', 'report', 'tuning', 'theory', 'ros'),
        'nodes',
    },
    'commission': {
        *('adrc', 'simulation', 'scenario', 'records', 'report', 'tuning', 'ros', 'nodes'),
        *('demo', 'live', 'wiring'),
    },
    'testing': {'adrc', 'simulation', 'scenario', 'records', 'report', 'ros', 'nodes', 'demo'},
    'cli': {
        *('adrc', 'simulation', 'scenario', 'records', 'report', 'tuning', 'ros', 'demo'),
        *('live', 'commission', 'export', 'wiring'),
    },
}
PURE = {'adrc', 'simulation', 'wiring'}
WITH_ROS = {'ros', 'nodes', 'demo', 'live', 'commission', 'testing', 'cli'}
IMPURE = {
    *('rclpy', 'std_msgs', 'std_srvs', 'rcl_interfaces', 'diagnostic_msgs', 'ament_index_python'),
    *('time', 'datetime', 'logging', 'os', 'pathlib', 'io', 'sys', 'random', 'secrets', 'socket'),
    *('threading', 'subprocess', 'asyncio', 'tempfile', 'shutil', 'scipy', 'matplotlib', 'yaml'),
}
LOUD = {'print', 'open', 'input', 'breakpoint', 'exec', 'eval'}
# What makes functions of code that it wrote itself.
MAKER = PACKAGE / 'adrc' / 'specialise' / 'python.py'
FORBIDDEN_AT_START = ('rclpy', 'time', 'logging', 'scipy', 'numba', 'matplotlib', 'yaml', 'typer')


def files(*layers: str) -> list[Path]:
    found = [path for layer in sorted(layers) for path in sorted((PACKAGE / layer).rglob('*.py'))]
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


def tops(path: Path) -> set[str]:
    return {name.split('.')[0] for name in imports(path)}


def layers_imported(path: Path) -> set[str]:
    parts = [name.split('.') for name in imports(path)]
    inner = {p.stem if p.is_file() else p.name for p in PACKAGE.iterdir()}
    return {p[1] for p in parts if p[0] == 'nadrc_ros' and len(p) > 1 and p[1] in inner}


@pytest.mark.parametrize('floor', ARROWS)
def test_an_import_only_points_down(floor: str) -> None:
    allowed = ARROWS[floor] | {floor} | (set() if floor in PURE else FILES)
    for path in files(floor):
        assert layers_imported(path) <= allowed, path
        assert floor in WITH_ROS or not tops(path) & {'rclpy', 'std_msgs'}, path


def test_every_folder_is_a_floor() -> None:
    assert {path.parent.name for path in PACKAGE.glob('*/__init__.py')} == set(ARROWS)


def test_no_imports_go_round_in_a_circle() -> None:
    modules = {
        '.'.join(path.relative_to(PACKAGE).with_suffix('').parts).removesuffix('.__init__'): path
        for path in files(*ARROWS)
    }
    inner = {}
    for name, path in modules.items():
        needs = {found.removeprefix('nadrc_ros.') for found in imports(path)} & set(modules)
        inner[name] = {
            need for need in needs if not any(other.startswith(f'{need}.') for other in needs)
        }
    while leaves := {name for name, needs in inner.items() if not (needs - {name}) & set(inner)}:
        inner = {name: needs for name, needs in inner.items() if name not in leaves}
    assert not inner, f'in a circle, or above one: {sorted(inner)}'


@pytest.mark.parametrize('floor', sorted(PURE))
def test_the_law_and_the_simulation_are_pure(floor: str) -> None:
    for path in files(floor):
        assert not tops(path) & IMPURE, path
        nodes = ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        called = {
            node.func.id
            for node in nodes
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        loud = LOUD - {'exec'} if path == MAKER else LOUD
        assert not called & loud, path


def test_numpy_stays_out_of_the_law() -> None:
    for path in files('adrc'):
        assert 'numpy' not in tops(path), path


def test_numba_is_named_where_it_compiles_only() -> None:
    using = {path for path in PACKAGE.rglob('*.py') if 'numba' in tops(path)}
    assert using == {
        PACKAGE / 'simulation' / f'{name}.py' for name in ('compiled', 'compiled_law')
    }
    using = {path for path in PACKAGE.rglob('*.py') if 'llvmlite' in tops(path)}
    assert using == {PACKAGE / 'simulation' / 'lowering.py'}


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
