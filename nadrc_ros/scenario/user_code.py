"""
Classes in Python files of the user's: found and constructed.

Everything that goes wrong in such a file, now or later in a run, becomes one sentence that names
the file and the line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import inspect
from math import isfinite
from pathlib import Path
import sys
from threading import RLock
import traceback
from types import ModuleType
from typing import Any
from zlib import crc32

import attrs
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UnknownName
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.scenario.errors import ScenarioError

LONGEST_MESSAGE = 200
# By path: what the file said when it was executed, and the module that came of it.
_MODULES: dict[str, tuple[bytes, ModuleType]] = {}
_LOCK = RLock()


@attrs.frozen
class Kind:
    """
    What is looked for in a file.

    ``name`` is the path of the setting that names the file, may be empty; ``method`` tells the
    class from others, ``plural`` is what several of them are called.
    """

    name: str
    method: str
    plural: str

    def path(self, key: str) -> str:
        """Return the dotted path of one of its settings."""
        return f'{self.name}.{key}' if self.name else key


def user_class(kind: Kind, file: str, class_name: str = '') -> type[Any]:
    """
    Return the class of that kind in a file, of that name where it has several.

    Raises
    ------
    ScenarioError
        When the code of the file fails, or the class is not clear.
    SettingError
        When the file cannot be read, or has no such class.

    """
    with blame(file, always=True):
        return _choose(kind, _classes(kind, _execute(kind, file)), class_name, file)


@contextmanager
def blame(*files: str, always: bool = False) -> Iterator[None]:
    """
    Turn an exception that came out of the code in ``files`` into a :class:`ScenarioError`.

    Others pass, unless ``always``, and so do those that explain themselves.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        cause = error.__cause__ if isinstance(error, SettingError) else error
        if cause is None or isinstance(cause, ScenarioError):
            raise
        lines = {file: _line_in(file, cause) for file in files}
        file = next((file for file, line in lines.items() if line is not None), '')
        if not file and not always:
            raise
        where = f'{file}, line {lines[file]}' if file else files[0]
        raise ScenarioError(f'{where}: {_one_line(cause)}') from None


def _execute(kind: Kind, file: str) -> ModuleType:
    """
    Return the file as a module, run again only once its text has changed.

    A class made anew for each use would be compiled anew, and kept, for each.
    """
    try:
        source = Path(file).read_bytes()
    except OSError as error:
        raise SettingError(kind.path('file'), file, f'a Python file ({error.strerror})') from None
    with _LOCK:
        before, module = _MODULES.get(file, (None, None))
        if module is None or before != source:
            module = _run(file, source)
            _MODULES[file] = source, module
        return module


def _run(file: str, source: bytes) -> ModuleType:
    # Under a name of its own: a file called math.py must not get in the way of math.
    module = ModuleType(f'_nadrc_user_{crc32(file.encode()):08x}')
    module.__file__ = file
    sys.modules[module.__name__] = module  # dataclasses look their module up
    try:
        exec(compile(source, file, 'exec'), module.__dict__)
    except BaseException:
        del sys.modules[module.__name__]
        raise
    return module


def _classes(kind: Kind, module: ModuleType) -> dict[str, type[Any]]:
    return {
        cls.__name__: cls
        for cls in vars(module).values()
        if isinstance(cls, type)
        and cls.__module__ == module.__name__
        and callable(getattr(cls, kind.method, None))
        and not getattr(cls, '_is_protocol', False)
    }


def _choose(kind: Kind, classes: dict[str, type[Any]], name: str, file: str) -> type[Any]:
    if not classes:
        raise SettingError(
            kind.path('file'), file, f'a file that defines a class with a method {kind.method}'
        )
    names = ', '.join(classes)
    if not name and len(classes) > 1:
        raise ScenarioError(
            f'{file} defines several {kind.plural}, so `class:` must name one of {names}'
        )
    if name and name not in classes:
        raise SettingError(
            kind.path('class'), name, f'one of the {kind.plural} in {file}: {names}'
        )
    return classes[name or next(iter(classes))]


def construct(kind: Kind, cls: type[Any], values: Mapping[str, Any]) -> Any:
    """
    Return an object of a class of the user's.

    Raises
    ------
    SettingError, ScenarioError
        For a value that the class does not take or refuses, or one that is missing.

    """
    taken = inspect.signature(cls).parameters
    others = any(p.kind is p.VAR_KEYWORD for p in taken.values())
    named = [p for p in taken.values() if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    names = [p.name for p in named]
    for key, value in values.items():
        if not others and key not in names:
            raise UnknownName(kind.path(key), value, did_you_mean(key, names))
        if not _is_plain(value):
            raise SettingError(
                kind.path(key), value, 'a finite number, a string, true or false, or a list of one'
            )
    for parameter in named:
        if parameter.default is parameter.empty and parameter.name not in values:
            path = kind.path(parameter.name)
            raise ScenarioError(f'{path} is missing: {cls.__name__} asks for it')
    if attrs.has(cls) and declared(cls):
        return build(cls, values, kind.name)
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
