"""The formats of the pictures that commands draw."""

# ruff: noqa: UP045
from pathlib import Path
from typing import Optional

import typer

FORMATS = ('png', 'svg', 'pdf')


def check_format(path: Optional[Path], option: str) -> None:
    """Refuse the name of a picture that does not say a known format."""
    if path is not None and path.suffix.lstrip('.') not in FORMATS:
        raise typer.BadParameter(f'{path} must end in .' + ', .'.join(FORMATS), param_hint=option)
