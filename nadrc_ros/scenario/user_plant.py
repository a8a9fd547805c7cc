"""
A plant in a Python file of the user's: loaded, constructed and checked.

Everything that goes wrong in that file, now or later in a run, becomes one sentence that names the
file and the line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import inspect
from math import isfinite
import os
from pathlib import Path
import sys
from threading import RLock
import traceback
from types import ModuleType
from typing import Any
from zlib import crc32

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.scenario.errors import ScenarioError
from nadrc_ros.simulation.plants import check_plant, Plant, plant_type

LONGEST_MESSAGE = 200
# By path: what the file said when it was executed, and the module that came of it.
_MODULES: dict[str, tuple[bytes, ModuleType]] = {}
_LOCK = RLock()


def load_plant(
    path: str | Path, class_name: str = '', values: Mapping[str, Any] | None = None
) -> Plant:
    """
    Return the plant that the Python file at ``path`` defines.

    Parameters
    ----------
    path
        The file.
    class_name
        Which class; may be empty if just one class in the file has a method ``derivative``.
    values
        Coefficients by name: fields of an attrs class, else keyword arguments of the class.

    Raises
    ------
    ScenarioError
        When the file cannot be read, its code fails, or the class is not clear.
    SettingError
        For a coefficient that the class does not take or refuses, or a class that is no plant.

    """
    file = os.path.abspath(path)
    with blame(file, always=True):
        cls = _choose(_plant_classes(_execute(file)), class_name, file)
        return make_plant(cls, values or {})


def make_plant(cls: type[Any], values: Mapping[str, Any]) -> Plant:
    """
    Return a plant of a class of the user's.

    Raises
    ------
    SettingError
        For a coefficient that the class does not take or refuses, or a class that is no plant.

    """
    return check_plant(_construct(cls, values))


def plant_class(name: str, class_name: str = '') -> type[Any]:
    """
    Return the class of a registered plant, or the one that the Python file ``name`` defines.

    Raises
    ------
    ScenarioError, SettingError
        As in :func:`load_plant`; also for a name that is neither.

    """
    if not name.endswith('.py'):
        return plant_type(name)
    file = os.path.abspath(name)
    with blame(file, always=True):
        return _choose(_plant_classes(_execute(file)), class_name, file)


@contextmanager
def blame(file: str, *, always: bool = False) -> Iterator[None]:
    """
    Turn an exception that came out of the code in ``file`` into a :class:`ScenarioError`.

    Others pass, unless ``always``, and so do those that explain themselves.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        cause = error.__cause__ if isinstance(error, SettingError) else error
        if cause is None or isinstance(cause, ScenarioError):
            raise
        line = _line_in(file, cause)
        if line is None and not always:
            raise
        where = file if line is None else f'{file}, line {line}'
        raise ScenarioError(f'{where}: {_one_line(cause)}') from None


def _execute(file: str) -> ModuleType:
    """
    Return the file as a module, run again only once its text has changed.

    A class made anew for each plant would be compiled anew, and kept, for each.
    """
    try:
        source = Path(file).read_bytes()
    except OSError as error:
        raise SettingError('plant.file', file, f'a Python file ({error.strerror})') from None
    with _LOCK:
        before, module = _MODULES.get(file, (None, None))
        if module is None or before != source:
            module = _run(file, source)
            _MODULES[file] = source, module
        return module


def _run(file: str, source: bytes) -> ModuleType:
    # Under a name of its own: a file called math.py must not get in the way of math.
    module = ModuleType(f'_nadrc_plant_{crc32(file.encode()):08x}')
    module.__file__ = file
    sys.modules[module.__name__] = module  # dataclasses look their module up
    try:
        exec(compile(source, file, 'exec'), module.__dict__)
    except BaseException:
        del sys.modules[module.__name__]
        raise
    return module


def _plant_classes(module: ModuleType) -> dict[str, type[Any]]:
    return {
        cls.__name__: cls
        for cls in vars(module).values()
        if isinstance(cls, type)
        and cls.__module__ == module.__name__
        and callable(getattr(cls, 'derivative', None))
        and not getattr(cls, '_is_protocol', False)
    }


def _choose(classes: dict[str, type[Any]], name: str, file: str) -> type[Any]:
    if not classes:
        raise SettingError(
            'plant.file', file, 'a file that defines a class with a method derivative'
        )
    names = ', '.join(classes)
    if not name and len(classes) > 1:
        raise ScenarioError(f'{file} defines several plants, so `class:` must name one of {names}')
    if name and name not in classes:
        raise SettingError('plant.class', name, f'one of the plants in {file}: {names}')
    return classes[name or next(iter(classes))]


def _construct(cls: type[Any], values: Mapping[str, Any]) -> Any:
    taken = inspect.signature(cls).parameters
    others = any(p.kind is p.VAR_KEYWORD for p in taken.values())
    named = [p for p in taken.values() if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    allowed = ', '.join(p.name for p in named) or 'none'
    for key, value in values.items():
        if not others and key not in [p.name for p in named]:
            raise SettingError(f'plant.{key}', value, f'left out: allowed keys are {allowed}')
        if not _is_plain(value):
            raise SettingError(
                f'plant.{key}', value, 'a finite number, a string, true or false, or a list of one'
            )
    for parameter in named:
        if parameter.default is parameter.empty and parameter.name not in values:
            raise ScenarioError(f'plant.{parameter.name} is missing: {cls.__name__} asks for it')
    if attrs.has(cls) and declared(cls):
        return build(cls, values, 'plant')
    return cls(**values)


def _is_plain(value: object) -> bool:
    """Tell whether a ROS parameter could hold ``value``."""
    if isinstance(value, list):
        kinds = {type(item) for item in value}
        plain = not any(isinstance(item, list) for item in value) and all(map(_is_plain, value))
        return plain and (len(kinds) == 1 or kinds == {int, float})
    if isinstance(value, (int, float)):
        return isfinite(value)
    return isinstance(value, str)


def _line_in(file: str, error: BaseException) -> int | None:
    """Return the line of ``file`` that ``error`` came from, None if it came from elsewhere."""
    if isinstance(error, SyntaxError) and error.filename == file:
        return error.lineno
    frames = traceback.extract_tb(error.__traceback__)
    return next((f.lineno for f in reversed(frames) if f.filename == file), None)


def _one_line(error: BaseException) -> str:
    message = error.msg if isinstance(error, SyntaxError) else str(error)
    message = ' '.join(message.split())[:LONGEST_MESSAGE]
    return f'{type(error).__name__}: {message}' if message else type(error).__name__
