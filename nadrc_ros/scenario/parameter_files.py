"""ROS parameters as plain data, and the text of a file for ``--params-file``."""

from __future__ import annotations

from collections.abc import Mapping
import re
from typing import Any

from nadrc_ros.adrc.cascade import loops_of
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
import yaml

Parameters = dict[str, Any]
# As a node's key in a parameter file: the controller node in whatever namespace it is. A plain
# /** would follow a node that is renamed, but be for plant and recorder too, which refuse it; a
# renamed controller refuses this key and says what to write.
ANY_CONTROLLER = '/**/controller'


class _Dumper(yaml.SafeDumper):
    """Quotes strings that the parser of ROS would take for true or false, such as the unit N."""


_Dumper.add_implicit_resolver('tag:yaml.org,2002:bool', re.compile('[yYnN]$'), list('yYnN'))


def controller_parameters(settings: ControllerSettings, rate: float) -> Parameters:
    """Return what makes a controller node run with these settings at ``rate`` [Hz]."""
    values = {name: getattr(settings, name) for name in declared(ControllerSettings)}
    plain = {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
    return {**plain, 'rate': rate}


def node_parameters(settings: ControllerSettings, rate: float) -> dict[str, Parameters]:
    """
    Return by node what runs a controller, or with ``--axes loop_1 loop_2 ...`` those of a cascade.

    ``loop_1`` is the outermost loop.
    """
    loops = [controller_parameters(each, rate) for each in loops_of(settings)]
    if len(loops) == 1:
        return {ANY_CONTROLLER: loops[0]}
    for i, inner in enumerate(loops[1:], 1):
        inner['reference_from'] = f'loop_{i}'
    return {f'/**/loop_{i}/controller': each for i, each in enumerate(loops, 1)}


def parameter_text(nodes: Mapping[str, Parameters]) -> str:
    """Return the YAML text of the parameters of each node, by its full name or a pattern."""
    content = {name: {'ros__parameters': parameters} for name, parameters in nodes.items()}
    text: str = yaml.dump(content, Dumper=_Dumper, sort_keys=False)
    return text


def about_reference(settings: ControllerSettings) -> str:
    """Return what these settings expect of a moving reference, nothing where it needs no more."""
    replaced = settings.error_based or settings.tracking_acceleration > 0.0
    if replaced or not settings.received_derivatives:
        return ''
    topics = ('reference/rate', 'reference/acceleration')[: settings.received_derivatives]
    if settings.reference_derivatives == 'auto':
        without = 'they are estimated from its samples: nearly as well where these are precise'
    else:
        without = 'it is followed late, but not with reference_derivatives: auto'
    return (
        f'a moving reference is followed as predicted if {" and ".join(topics)} come too; where '
        f'they do not, {without}'
    )
