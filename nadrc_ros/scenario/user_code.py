"""
Classes in Python files of the user's: found, described and constructed.

Everything that goes wrong in such a file, now or later in a run, becomes one sentence that names
the file and the line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import inspect
from math import isfinite
import os
from pathlib import Path
import sys
from threading import RLock
import traceback
from types import ModuleType
from typing import Any, Generic, TypeVar
from zlib import crc32

import attrs
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UnknownName, UserError
from nadrc_ros.adrc.fields import build, Declared, declared, Registry

T = TypeVar('T')
_LONGEST_MESSAGE = 200
_KIND_OF = {bool: 'flag', str: 'text', int: 'number', float: 'number'}
# By path: what the file said when it was executed, and the module that came of it.
_MODULES: dict[str, tuple[bytes, ModuleType]] = {}
_LOCK = RLock()


class ScenarioError(UserError):
    """
    A scenario cannot be read, lacks a key, or brings a plant whose code fails.

    The message is one sentence for the user. A bad value is a ``SettingError`` instead.
    """


@attrs.frozen(kw_only=True)
class Kind(Generic[T]):
    """
    Plants, or signals: those of this package, and what a class of a user's must have to be one.

    ``known`` are the registered ones; ``method`` tells such a class from others, ``check`` whether
    an object of it works; ``plural`` is what several are called. Settings are named below
    ``path``, which may be empty.
    """

    known: Registry[type[T]]
    method: str
    check: Callable[[Any], T]
    plural: str
    path: str = ''

    def named(self, key: str) -> str:
        """Return the dotted path of one of the settings."""
        return f'{self.path}.{key}' if self.path else key

    def type_of(self, source: str, class_name: str = '') -> type[Any]:
        """
        Return a registered class by its name, or that in the Python file ``source``.

        Raises
        ------
        ScenarioError
            When the code of the file fails, or it has several such classes and none is named.
        SettingError
            When the name is unknown, or the file cannot be read or has no such class.

        """
        return self._class_in(source, class_name) if source.endswith('.py') else self.known[source]

    def load(
        self, path: str | Path, class_name: str = '', values: Mapping[str, Any] | None = None
    ) -> T:
        """
        Return an object of a class in the Python file at ``path``, made from ``values``.

        Raises
        ------
        ScenarioError, SettingError
            As :meth:`type_of` and :meth:`make` do.

        """
        with blame(os.path.abspath(path), always=True):
            return self.make(self._class_in(path, class_name), values or {})

    def make(self, cls: type[Any], values: Mapping[str, Any]) -> T:
        """
        Return an object of a class of the user's.

        Raises
        ------
        SettingError, ScenarioError
            For a value that the class does not take or refuses, one that is missing, or a class
            whose objects are not of this kind.

        """
        return self.check(_construct(self, cls, values))

    def _class_in(self, path: str | Path, name: str) -> type[Any]:
        file = os.path.abspath(path)
        with blame(file, always=True):
            module = _execute(self, file)
        classes = {
            cls.__name__: cls
            for cls in vars(module).values()
            if isinstance(cls, type)
            and cls.__module__ == module.__name__
            and callable(getattr(cls, self.method, None))
            and not getattr(cls, '_is_protocol', False)
        }
        names = ', '.join(classes)
        if not classes:
            allowed = f'a file that defines a class with a method {self.method}'
            raise SettingError(self.named('file'), file, allowed)
        if not name and len(classes) > 1:
            raise ScenarioError(
                f'{file} defines several {self.plural}, so `class:` must name one of {names}'
            )
        if name and name not in classes:
            allowed = f'one of the {self.plural} in {file}: {names}'
            raise SettingError(self.named('class'), name, allowed)
        return classes[name or names]


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


def class_fields(cls: type[Any]) -> dict[str, Declared]:
    """
    Return what is known of each argument of a class, by name.

    The arguments of a plain class are described by their defaults, which they must have.

    Raises
    ------
    ScenarioError
        When an argument has no default that a parameter can hold.

    """
    if attrs.has(cls) and declared(cls):
        return declared(cls)
    fields = {}
    for argument in inspect.signature(cls).parameters.values():
        if argument.kind in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD):
            continue
        kind, default = _KIND_OF.get(type(argument.default)), argument.default
        if kind is None:
            raise ScenarioError(
                f'{cls.__name__}: {argument.name} needs a default that is a number, a string or '
                'a flag'
            )
        fields[argument.name] = Declared(
            kind=kind,
            default=float(default) if kind == 'number' else default,
            description=f'argument of {cls.__name__}',
            live=False,
        )
    return fields


def _execute(kind: Kind[Any], file: str) -> ModuleType:
    """
    Return the file as a module, run again only once its text has changed.

    A class made anew for each use would be compiled anew, and kept, for each.
    """
    try:
        source = Path(file).read_bytes()
    except OSError as error:
        allowed = f'a Python file ({error.strerror})'
        raise SettingError(kind.named('file'), file, allowed) from None
    with _LOCK:
        before, module = _MODULES.get(file, (None, None))
        if module is None or before != source:
            # Under a name of its own: a file called math.py must not get in the way of math.
            module = ModuleType(f'_nadrc_user_{crc32(file.encode()):08x}')
            module.__file__ = file
            sys.modules[module.__name__] = module  # dataclasses look their module up
            try:
                exec(compile(source, file, 'exec'), module.__dict__)
            except BaseException:
                del sys.modules[module.__name__]
                raise
            _MODULES[file] = source, module
        return module


def _construct(kind: Kind[Any], cls: type[Any], values: Mapping[str, Any]) -> Any:
    taken = inspect.signature(cls).parameters
    others = any(p.kind is p.VAR_KEYWORD for p in taken.values())
    named = [p for p in taken.values() if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    names = [p.name for p in named]
    for key, value in values.items():
        if not others and key not in names:
            raise UnknownName(kind.named(key), value, did_you_mean(key, names))
        if not _is_plain(value):
            allowed = 'a finite number, a string, true or false, or a list of one'
            raise SettingError(kind.named(key), value, allowed)
    for parameter in named:
        if parameter.default is parameter.empty and parameter.name not in values:
            path = kind.named(parameter.name)
            raise ScenarioError(f'{path} is missing: {cls.__name__} asks for it')
    return build(cls, values, kind.path) if attrs.has(cls) and declared(cls) else cls(**values)


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
    message = ' '.join(message.split())[:_LONGEST_MESSAGE]
    return f'{type(error).__name__}: {message}' if message else type(error).__name__
