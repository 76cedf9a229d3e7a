"""The command ``proofmass``, also ``python -m proofmass``."""

import codecs
import os
import sys
from contextlib import suppress

from proofmass.base.errors import BAD_INPUT, INTERRUPTED

SUBSTITUTES = str.maketrans(
    {"✓": "+", "✗": "x", "·": ".", "≈": "~", "–": "-", "−": "-", "×": "x", "…": "...", "→": "->"}
)
"""Characters of tables and sentences, and what stands for them where they cannot be printed."""


def main() -> None:
    """Load the commands, which takes a second that Ctrl-C may fall into, and run one."""
    leave_current_folder_out()
    print_all_characters()
    try:
        from proofmass.base.worker import LIGHT_IMPORTS

        os.environ.update(LIGHT_IMPORTS | os.environ)
        from proofmass.commands.cli import app
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    try:
        app()
    except OSError as error:  # that of an output file has its name
        end_with_error(error)
    except SystemExit as end:
        flush_output(end)
        raise


def leave_current_folder_out() -> None:
    """Import nothing from the current folder, which ``python -m`` puts first and may be foreign."""
    with suppress(OSError):  # a current folder that somebody has removed
        if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
            del sys.path[0]


def print_all_characters() -> None:
    """Let the standard streams print any text, whatever their encoding is."""
    codecs.register_error("proofmass", substitute)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="proofmass")


def substitute(error: UnicodeError) -> tuple[str | bytes, int]:
    r"""Replace characters that an encoding does not have; a byte of a file's name stays itself.

    >>> codecs.register_error("proofmass", substitute)
    >>> "✓ agrees, β, caf\udce9".encode("ascii", "proofmass")
    b'+ agrees, \\u03b2, caf\xe9'
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    first = error.object[error.start]
    if "\udc80" <= first <= "\udcff":
        return bytes([ord(first) - 0xDC00]), error.start + 1
    found = first.translate(SUBSTITUTES)
    return found.encode("ascii", "backslashreplace").decode(), error.start + 1


def flush_output(end: SystemExit) -> None:
    """Write what is left of standard output; if that fails, end with an error instead."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as ``head``, has enough
        discard_output()
    except OSError as error:
        if end.code == BAD_INPUT:  # an error is printed already
            discard_output()
        else:
            end_with_error(error)


def end_with_error(error: OSError) -> None:
    """Print an error of the system as one line, and exit."""
    discard_output()
    with suppress(OSError):
        place = error.filename or "standard output"
        print(f"error: {place}: {error.strerror or error}", file=sys.stderr, flush=True)
    sys.exit(BAD_INPUT)


def discard_output() -> None:
    """Drop what was not written to standard output, so that Python does not try again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
