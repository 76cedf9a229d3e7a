"""The commit that a folder is at, read from the files of its repository.

Git itself is not asked: in a repository of somebody else its commands may run programs of that
repository (``core.fsmonitor``, filters, hooks).  Whether files differ from the commit is therefore
not known, since only git's index and objects tell that.
"""

import re
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import read_bytes

COMMIT = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")  # SHA-1 or SHA-256
BRANCH = re.compile(r"ref: (refs/[\w./@+=,#%-]+)")
"""What HEAD has if it is at a branch; git allows other characters, with which no commit is read."""
LONGEST_FILE = 2**24
"""Size [bytes] of the largest file that is read: packed-refs of 200,000 branches and tags."""


def commit_of(place: Path) -> str:
    """Return the commit of the working tree of a path; empty if there is none that can be read.

    It is the commit that HEAD names, as a branch, in ``packed-refs`` or by itself, also in the
    working trees of ``git worktree`` and of submodules.
    """
    start = place.absolute()
    for folder in (start, *start.parents):
        if (folder / ".git").exists():
            return head_commit(git_folder(folder / ".git"))
    return ""


def git_folder(entry: Path) -> Path:
    """Return the folder of a repository, which ``.git`` is or names."""
    named = read_line(entry) if entry.is_file() else ""
    return entry.parent / named.removeprefix("gitdir: ") if named else entry


def head_commit(folder: Path) -> str:
    """Return the commit that HEAD names in the folder of a repository; empty if none is found."""
    head = read_line(folder / "HEAD")
    if COMMIT.fullmatch(head):
        return head
    branch = BRANCH.fullmatch(head)
    if not branch or ".." in branch[1]:
        return ""
    common = folder / (read_line(folder / "commondir") or ".")  # of a working tree's own folder
    for place in (folder, common):
        if COMMIT.fullmatch(loose := read_line(place / branch[1])):
            return loose
    return packed_commit(common / "packed-refs", branch[1])


def packed_commit(file: Path, branch: str) -> str:
    """Return the commit of a branch in ``packed-refs``; empty if it is not there."""
    for line in read_small(file).splitlines():
        commit, _, name = line.partition(" ")
        if name == branch and COMMIT.fullmatch(commit):
            return commit
    return ""


def read_line(file: Path) -> str:
    """Return the only line of a file; empty if it cannot be read."""
    return read_small(file).strip()


def read_small(file: Path) -> str:
    """Return the text of a file; empty if it cannot be read or is too large."""
    try:
        if file.stat().st_size > LONGEST_FILE:
            return ""
        return read_bytes(file).decode(errors="replace")
    except (OSError, ValueError, InputError):
        return ""
