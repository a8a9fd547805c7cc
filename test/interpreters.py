"""
Whether another Python could run this: `make lint` starts this file with each that is there.

Needs nothing but that Python. Every file has to compile without a warning, and every name that is
imported from the standard library has to be in it.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
import sys
import warnings

FOLDERS = ('nadrc_ros', 'launch', 'paper', 'examples', 'bench', 'docs', 'test')


def complaints(path: Path) -> list[str]:
    """Return what this Python does not like about a file."""
    try:
        tree = ast.parse(path.read_bytes())
        compile(tree, str(path), 'exec')
    except (SyntaxError, SyntaxWarning, DeprecationWarning) as error:
        return [f'{path}: {error}']
    missing = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            wanted = [(alias.name, '') for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            wanted = [(node.module, alias.name) for alias in node.names]
        else:
            continue
        missing += [
            f'{path}:{node.lineno}: there is no {module} {name}'
            for module, name in wanted
            if is_standard(module) and not is_there(module, name)
        ]
    return missing


def is_standard(module: str) -> bool:
    """Tell whether a module is of the standard library, as far as Python 3.10 to here had it."""
    gone = {'asynchat', 'asyncore', 'cgi', 'distutils', 'imp', 'pipes', 'smtpd', 'telnetlib'}
    return module.partition('.')[0] in (sys.stdlib_module_names | gone)


def is_there(module: str, name: str) -> bool:
    """Tell whether a module can be imported, and has a name."""
    try:
        if not name or hasattr(import_module(module), name):
            return bool(import_module(module))
        return bool(import_module(f'{module}.{name}'))
    except ImportError:
        return False


def main() -> int:
    """Check all files, and say how many there were."""
    warnings.simplefilter('error')
    root = Path(__file__).resolve().parents[1]
    files = [path for folder in FOLDERS for path in sorted((root / folder).rglob('*.py'))]
    found = [each for path in [root / 'setup.py', *files] for each in complaints(path)]
    print(f'Python {sys.version.split()[0]}: {len(files)} files', *found, sep='\n')
    return bool(found)


if __name__ == '__main__':
    raise SystemExit(main())
