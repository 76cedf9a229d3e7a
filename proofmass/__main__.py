"""The command ``proofmass``, also ``python -m proofmass``."""

import os
import sys


def main() -> None:
    """Load the commands, which takes a second that Ctrl-C may fall into, and run one."""
    leave_current_folder_out()
    try:
        from proofmass.worker import NO_RENDERER

        os.environ.update(NO_RENDERER | os.environ)
        from proofmass.cli import app
    except KeyboardInterrupt:
        sys.exit(130)  # as a shell says it; to ask `proofmass.command` would be to load it
    app()


def leave_current_folder_out() -> None:
    """Import nothing from the current folder, which ``python -m`` puts first and may be foreign."""
    if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
        del sys.path[0]


if __name__ == "__main__":
    main()
