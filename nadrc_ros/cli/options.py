"""The options of commands that set declared fields, described by the fields themselves."""

from typing import Any

from nadrc_ros.adrc.fields import Declared
import typer


def option(field: Declared, default: str = '') -> Any:
    """Return the option that sets a field; typer says the default unless it is given in words."""
    choices = ': ' + ', '.join(field.choices) if field.choices else ''
    unit = f' [{field.unit}]' if field.unit else ''
    said = f' (default {default})' if default else ''
    text = f'{field.description[0].upper()}{field.description[1:]}{choices}{unit}{said}.'
    return typer.Option(help=text.replace('[', '\\['))
