"""The `nadrc` command line."""

from __future__ import annotations

# What has no character of ASCII in it.
PLAIN = {'\N{MINUS SIGN}': '-', '\N{MULTIPLICATION SIGN}': 'x', '\N{DEGREE SIGN}': 'deg'}


def main() -> None:
    """Run the command line."""
    import codecs
    import os
    import sys

    codecs.register_error('plain', _plain)
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # as behind >&-
            stream.reconfigure(errors='plain')  # type: ignore[union-attr]
    # The matrices here are small: threads of OpenBLAS would only wait for them, and busily.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    try:
        from nadrc_ros.cli.app import app

        app()
    except (Exception, KeyboardInterrupt) as error:  # while the modules were being imported
        if interrupted(error):
            sys.exit(130)
        if isinstance(error, OSError):  # a full disk behind >
            sys.exit(f'nadrc: output: {error.strerror}')
        raise


def called() -> str:
    """Return how this command line was called, for lines to be copied."""
    import os

    return os.environ.get('NADRC', 'nadrc')


def interrupted(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C is behind an error: inside an import it may come out as another one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Return what stands for characters that the output cannot show: 2 for a superscript."""
    from unicodedata import normalize

    assert isinstance(error, UnicodeEncodeError)
    text = ''
    for character in error.object[error.start : error.end]:
        plain = PLAIN.get(character, normalize('NFKD', character)).encode('ascii', 'ignore')
        text += plain.decode() or '?'
    return text, error.end
