"""What becomes of models of anybody, without a sidecar: a table of model, outcome and message.

    uv run python -m benchmarks.foreign FOLDER

Each ``.xml`` below the folder is loaded and stepped for 0.1 s, as `proofmass check` does.  The
public repository of MuJoCo has such folders, ``model`` and ``test``; files that are only parts of
others are among them.
"""

import sys
from collections import Counter
from pathlib import Path

from proofmass.check import step_unchecked
from proofmass.errors import InputError


def outcome(model: Path) -> tuple[str, str]:
    """What comes of a model, and why; bad input is what the engine or proofmass refuses."""
    try:
        (found,) = step_unchecked(model)
    except InputError as error:
        return "refused", error.wrong
    return found.outcome, found.message


def main(folder: Path) -> None:
    """Print the table, and how often each outcome stands in it."""
    counts = Counter[str]()
    for model in sorted(folder.rglob("*.xml")):
        word, message = outcome(model)
        counts[word] += 1
        print(f"{model.relative_to(folder)} | {word} | {message}", flush=True)
    print(", ".join(f"{count} {word}" for word, count in counts.most_common()))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
