"""The command ``proofmass``, also ``python -m proofmass``."""

import os
import sys


def main() -> None:
    """Load the commands, which takes a second that Ctrl-C may fall into, and run one."""
    try:
        from proofmass.worker import NO_RENDERER

        os.environ.update(NO_RENDERER | os.environ)
        from proofmass.cli import app
    except KeyboardInterrupt:
        sys.exit(130)  # as a shell says it; to ask `proofmass.command` would be to load it
    app()


if __name__ == "__main__":
    main()
