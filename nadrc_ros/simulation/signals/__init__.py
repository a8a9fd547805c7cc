"""The signals by name: references and disturbances. One more is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nadrc_ros.adrc.errors import one_of, SettingError
from nadrc_ros.adrc.fields import build, Declared, declared, refuse_unknown_keys
from nadrc_ros.simulation.signals.chirp import Chirp
from nadrc_ros.simulation.signals.decaying_cosine import DecayingCosine
from nadrc_ros.simulation.signals.elementary import Constant, Nothing, Ramp, Step
from nadrc_ros.simulation.signals.periodic import Cosine, Sine, Square
from nadrc_ros.simulation.signals.protocol import check_signal, Signal
from nadrc_ros.simulation.signals.trapezoid import Trapezoid

__all__ = [
    'SIGNALS',
    'Signal',
    'check_signal',
    'make_signal',
    'signal_fields',
    'signal_type',
]

SIGNALS: dict[str, type[Signal]] = {
    'none': Nothing,
    'constant': Constant,
    'step': Step,
    'ramp': Ramp,
    'sine': Sine,
    'cosine': Cosine,
    'square': Square,
    'chirp': Chirp,
    'trapezoid': Trapezoid,
    'decaying_cosine': DecayingCosine,
}


def signal_fields() -> dict[str, Declared]:
    """Return the union of the fields of all signals, by name: what a node declares."""
    return {name: field for cls in SIGNALS.values() for name, field in declared(cls).items()}


def signal_type(name: str) -> type[Signal]:
    """
    Return the signal class of that name, for instance to ``build`` it from its own fields.

    Raises
    ------
    SettingError
        For an unknown name.

    """
    if name not in SIGNALS:
        raise SettingError('signal', name, one_of(name, SIGNALS))
    return SIGNALS[name]


def make_signal(name: str, values: Mapping[str, Any]) -> Signal:
    """
    Return the signal of that name, picking its own fields out of ``values``.

    ``values`` may hold fields that only other signals have (a node holds them all); those are not
    looked at.

    Raises
    ------
    SettingError
        For an unknown name, a key that no signal has, or a value that the signal refuses.

    """
    cls = signal_type(name)
    known, own = signal_fields(), declared(cls)
    refuse_unknown_keys(values, known)
    return build(cls, {key: value for key, value in values.items() if key in own})
