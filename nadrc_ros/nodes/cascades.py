"""Axes of one process of which one takes the command of another as its reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from graphlib import TopologicalSorter
from typing import Any, Protocol, TypeVar

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UserError
from nadrc_ros.adrc.status import Cause
from nadrc_ros.ros.pacing import PacingSettings, SharedTimer
from nadrc_ros.ros.runtime import BAD_START

_KEY = 'reference_from'


class Axis(Protocol):
    """The controller node of an axis."""

    reference_from: str
    controller: Controller
    ticker: Any
    timer: SharedTimer
    pacing: PacingSettings

    def lead(self) -> None:
        """Note that an inner loop takes the command."""

    def discard(self) -> None:
        """Leave nothing behind."""

    def get_parameter(self, name: str) -> Any:
        """Return a parameter."""


A = TypeVar('A', bound=Axis)


def make_joined(names: Sequence[str], make: Callable[[str, A | None], A]) -> list[A]:
    """
    Return what ``make`` makes of each name and the first axis, the cascades among them joined.

    The name of a controller that is no axis is empty.

    Raises
    ------
    UserError
        Names the axis that cannot be; what the others began to write is gone.

    """
    axes: dict[str, A] = {}
    name = ''
    try:
        for name in names:
            axes[name] = make(name, next(iter(axes.values()), None))
        join_cascades(axes)
        for name, node in axes.items():  # not before: that may be no cascade in lockstep
            _check_length(name, node)
    except BAD_START as error:
        for node in axes.values():
            node.discard()
        if not name or len(axes) == len(names):
            raise
        raise UserError(f'axis {name}: {error}') from error
    return list(axes.values())


def _check_length(name: str, node: Axis) -> None:
    try:
        node.pacing.check_length()
    except SettingError as error:
        raise UserError(f'axis {name}: {error}' if name else str(error)) from None


def waits_at_start(controller: Controller) -> bool:
    """
    Tell whether it holds for an inner loop that has yet to begin, which is no fault.

    Or for one that has begun by now: the outer loop, which ticks first, hears of it a tick later.
    """
    inner, waits = controller.inner, controller.cause == Cause.NOT_FOLLOWED
    return waits and inner is not None and inner.cause in (Cause.START, Cause.NONE)


def join_cascades(axes: Mapping[str, Axis]) -> None:
    """
    Join the inner loops among the axes, by name, to those around them, which tick before them.

    Raises
    ------
    UserError
        Names the axis, and why it cannot take its reference from where it is asked to.

    """
    sources = {name: node.reference_from for name, node in axes.items() if node.reference_from}
    for name, source in sources.items():
        try:
            _check(axes, sources, name)
            outer = axes[source]
            outer.controller.join(axes[name].controller)
        except SettingError as error:
            raise UserError(f'axis {name}: {error}' if name else str(error)) from None
        outer.lead()
    if sources:
        graph = {name: [sources[name]] if name in sources else [] for name in axes}
        order = TopologicalSorter(graph).static_order()
        ranks: dict[Any, int] = {axes[name].ticker: i for i, name in enumerate(order)}
        # All others, which send what the axes have said, stay behind them.
        listeners = next(iter(axes.values())).timer.listeners
        listeners.sort(key=lambda listen: ranks.get(getattr(listen, '__self__', None), len(ranks)))


def _check(axes: Mapping[str, Axis], sources: Mapping[str, str], name: str) -> None:
    """Refuse what is no other axis, is taken already, goes in a circle, or has no common tick."""
    source, node = sources[name], axes[name]
    others = [axis for axis in axes if axis != name]
    if source not in others:
        known = did_you_mean(source, others)
        allowed = f'another axis of this process, as --axes names them: {known}'
        raise SettingError(_KEY, source, allowed)
    rival = next(axis for axis in sources if sources[axis] == source)
    if rival != name:
        allowed = f'an axis without an inner loop so far: {rival} takes the command of {source}'
        raise SettingError(_KEY, source, allowed)
    circle = [name]
    while (before := sources.get(circle[-1], '')) not in ('', name):
        circle.append(before)
        if len(circle) > len(axes):
            return  # another circle, which is told of an axis in it
    if before == name:
        circle.append(name)
        raise SettingError(_KEY, source, f'in no circle, as {" <- ".join(circle)} is')
    for key, allowed in (('pacing', 'realtime'), ('trigger', 'timer')):
        value = node.get_parameter(key).value
        if value != allowed:
            why = f'{allowed} with {_KEY}: both loops act in the same tick'
            raise SettingError(key, value, why)
