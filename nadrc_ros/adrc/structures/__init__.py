"""The registry of observer structures: each module here that defines ``STRUCTURE`` is one."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from nadrc_ros.adrc.structures.structure import Structure

_MODULES = [import_module(f'{__name__}.{module.name}') for module in iter_modules(__path__)]

STRUCTURES: dict[str, Structure] = {
    module.STRUCTURE.name: module.STRUCTURE for module in _MODULES if hasattr(module, 'STRUCTURE')
}

__all__ = ['STRUCTURES', 'Structure']
