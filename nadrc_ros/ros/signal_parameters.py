"""The parameters by which a node is told of a signal: a registered one, or one of the user's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.scenario.csv_signal import CsvColumn
from nadrc_ros.scenario.specs import SIGNAL, SignalSpec
from nadrc_ros.scenario.user_code import class_fields
from nadrc_ros.simulation.protocols import Signal
from nadrc_ros.simulation.signals import make_signal, signal_fields, SIGNALS
from rclpy.node import Node

Parameters = dict[str, Any]


@attrs.frozen
class SignalParameters:
    """
    The names of the parameters of one signal of a node.

    ``key`` is the one that says which signal: a registered one, whose fields are those of all
    signals behind ``prefix``, or a file that ends in .py or .csv, fixed at start, whose own fields
    are behind ``key`` and a ``_``.
    """

    key: str
    prefix: str
    default: str
    description: str

    def fields(self, source: str = '', class_name: str = '') -> dict[str, Declared]:
        """
        Return what is known of each parameter, with a signal of the user's if ``source`` is one.

        Raises
        ------
        ScenarioError, SettingError
            When the file fails.

        """
        if not _is_file(source):
            which = Declared(
                kind='choice',
                default=self.default,
                choices=tuple(SIGNALS),
                description=f'{self.description}; or a file that ends in .py or .csv',
            )
            return {self.key: which} | behind(self.prefix, signal_fields())
        own = {self.key: _fixed(source, self.description)}
        if source.endswith('.csv'):
            return own | behind(f'{self.key}_', declared(CsvColumn))
        own[f'{self.key}_class'] = _fixed(class_name, 'class in that file, where it has several')
        return own | behind(f'{self.key}_', class_fields(SIGNAL.type_of(source, class_name)))

    def asked(self, node: Node) -> dict[str, Declared]:
        """Return :meth:`fields` for what the node was started with."""
        given = [
            getattr(node._parameter_overrides.get(name), 'value', '')
            for name in (self.key, f'{self.key}_class')
        ]
        source, class_name = (value if isinstance(value, str) else '' for value in given)
        return self.fields(source, class_name)

    def make(self, values: Mapping[str, Any]) -> Signal:
        """
        Return the signal that the parameters describe.

        Raises
        ------
        ScenarioError, SettingError
            For a value that is refused, by the name of its parameter.

        """
        source = values[self.key]
        prefix = f'{self.key}_' if _is_file(source) else self.prefix
        own = without(prefix, {k: value for k, value in values.items() if k != self.key})
        try:
            if source.endswith('.py'):
                class_name = own.pop('class')
                return SignalSpec(file=source, class_name=class_name, values=own).make()
            if source.endswith('.csv'):
                return SignalSpec(csv=source, values=own).make()
            return make_signal(source, own)
        except SettingError as error:
            named = error.name in ('signal', 'file', 'csv')
            name = self.key if named else prefix + error.name
            raise SettingError(name, error.value, error.allowed) from None

    def of(self, spec: SignalSpec) -> Parameters:
        """Return the parameters that describe a signal of a scenario."""
        source = spec.file or spec.csv
        found: Parameters = {self.key: source or spec.name}
        if spec.class_name:
            found[f'{self.key}_class'] = spec.class_name
        prefix = f'{self.key}_' if source else self.prefix
        fields = self.fields(source, spec.class_name)
        for name, value in spec.values.items():
            number = fields[prefix + name].kind == 'number'
            found[prefix + name] = float(value) if number else value
        return found


def _is_file(source: str) -> bool:
    return source.endswith(('.py', '.csv'))


def behind(prefix: str, fields: Mapping[str, Declared]) -> dict[str, Declared]:
    """Return declarations by their names behind a prefix."""
    return {prefix + name: field for name, field in fields.items()}


def without(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values whose names begin so, by the rest of the name."""
    return {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}


def _fixed(value: str, description: str) -> Declared:
    return Declared(kind='text', default=value, description=description, live=False)


REFERENCE = SignalParameters('signal', '', 'cosine', 'shape of the reference')
DISTURBANCE = SignalParameters(
    'disturbance', 'disturbance_', 'none', 'disturbance w added to y^(n)'
)
FEED_FORWARD = SignalParameters(
    'feed_forward', 'feed_forward_', 'none', 'signal on feed_forward, if it is one at the start'
)
NOISE_SIGNAL = SignalParameters(
    'noise_signal', 'noise_signal_', 'none', 'signal added to the measurement beside the noise'
)
