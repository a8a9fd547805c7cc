"""The `nadrc` command line, as an executable and for `python -m nadrc_ros.cli`."""

from __future__ import annotations

from typing import Any

from nadrc_ros.cli import interrupted

# What has no character of ASCII in it.
_PLAIN = {'\N{MINUS SIGN}': '-', '\N{MULTIPLICATION SIGN}': 'x', '\N{DEGREE SIGN}': 'deg'}


def live() -> None:
    """Run `nadrc live` as `ros2 run` does, with what is for ROS behind it."""
    import sys

    words = sys.argv[1:]
    main(['live', *(words[: words.index('--ros-args')] if '--ros-args' in words else words)])


def main(words: list[str] | None = None) -> None:
    """Run the command line, that of the process or another one."""
    import codecs
    import os
    import sys

    codecs.register_error('plain', _plain)
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # as behind >&-
            stream.reconfigure(errors='plain')  # type: ignore[union-attr]
    # The matrices here are small: threads of OpenBLAS would only wait for them, and busily.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.unraisablehook = _interrupt_again
    try:
        _run(words)
    except SystemExit as end:
        if end.code:
            _drop_unwritten()
        raise


def _run(words: list[str] | None) -> None:
    import sys

    try:
        from nadrc_ros.cli.app import app

        app(words, prog_name='nadrc')
    except (Exception, KeyboardInterrupt) as error:  # while the modules were being imported
        if interrupted(error):
            sys.exit(130)
        if isinstance(error, OSError):  # a full disk behind >
            sys.exit(f'error: output: {error.strerror}')
        raise


def _drop_unwritten() -> None:
    """Let go of output that cannot be written, of which the interpreter would complain again."""
    import os
    import sys

    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:  # a full disk behind >
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _interrupt_again(unraisable: Any) -> None:
    """Repeat a Ctrl-C that came where nothing can be raised, as in a callback of the compiler."""
    from _thread import interrupt_main
    import sys
    from threading import Timer

    if unraisable.exc_type is KeyboardInterrupt:
        Timer(0.05, interrupt_main).start()
    else:
        sys.__unraisablehook__(unraisable)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Return what stands for characters that the output cannot show: 2 for a superscript."""
    from unicodedata import normalize

    assert isinstance(error, UnicodeEncodeError)
    text = ''
    for character in error.object[error.start : error.end]:
        plain = _PLAIN.get(character, normalize('NFKD', character)).encode('ascii', 'ignore')
        text += plain.decode() or '?'
    return text, error.end


if __name__ == '__main__':
    main()
