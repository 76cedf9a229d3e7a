"""Make a release: its version, a commit, a tag, and the files for an index of packages.

    uv run python .ci/release.py VERSION [--make]

Without --make nothing is changed: the files are built in a temporary folder from the last commit,
with the version in it, and `twine check` reads them.  With --make the version is also written into
pyproject.toml, the only place that states it, and into CITATION.cff, with the date; both are
committed and tagged, and the files are put into dist/.  Nothing is sent to a network.
"""

import argparse
import datetime
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
VERSION = re.compile(r"\d+\.\d+\.\d+((a|b|rc)\d+)?")
"""A final version, or one before it such as 0.2.0rc1."""


def main(argv: list[str] | None = None) -> int:
    """Tell what is in the way of a release, or make it; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("version")
    parser.add_argument("--make", action="store_true", help="write, commit, tag and fill dist/")
    given = parser.parse_args(argv)
    obstacles = list(find_obstacles(ROOT, given.version))
    for obstacle in obstacles:
        print(f"not yet: {obstacle}", file=sys.stderr)
    if obstacles:
        return 1
    with TemporaryDirectory() as folder:
        files = build_files(ROOT, given.version, Path(folder))
        if given.make:
            tag_version(ROOT, given.version)
            (ROOT / "dist").mkdir(exist_ok=True)
            for file in files:
                shutil.copy(file, ROOT / "dist")
    print(*(file.name for file in files), sep="\n")
    if given.make:
        print(f"tagged v{given.version}; send it: git push --follow-tags, twine upload dist/*")
    else:
        print("built and checked; nothing was changed. --make writes, commits and tags")
    return 0


def find_obstacles(root: Path, version: str) -> Iterator[str]:
    """What is in the way of a release of a version, a sentence each."""
    if not VERSION.fullmatch(version):
        yield f"{version!r} is no version such as 0.2.0 or 0.2.0rc1"
    if f"## {version}" not in (root / "CHANGELOG.md").read_text(encoding="utf-8").splitlines():
        yield f"CHANGELOG.md has no section '## {version}'"
    if run_git(root, "tag", "--list", f"v{version}"):
        yield f"the tag v{version} exists"
    if run_git(root, "status", "--porcelain", "--untracked-files=no"):
        yield "there are changes that are not committed"


def build_files(root: Path, version: str, folder: Path) -> list[Path]:
    """Build the source distribution and the wheel of the last commit, and have twine check them."""
    source, files = folder / "source", folder / "files"
    source.mkdir()
    archive = folder / "source.tar"
    run_git(root, "archive", "--output", str(archive), "HEAD")
    shutil.unpack_archive(archive, source, filter="data")
    write_version(source, version)
    run_python("build", "--no-isolation", "--outdir", str(files), str(source))
    built = sorted(files.iterdir())
    run_python("twine", "check", "--strict", *map(str, built))
    return built


def write_version(root: Path, version: str) -> None:
    """Write a version into pyproject.toml and CITATION.cff, and today's date into the latter."""
    today = datetime.date.today().isoformat()
    replace_line(root / "pyproject.toml", r'^version = ".*"$', f'version = "{version}"')
    replace_line(
        root / "CITATION.cff",
        r"^version: .*(\ndate-released: .*)?$",
        f"version: {version}\ndate-released: {today}",
    )


def replace_line(file: Path, pattern: str, line: str) -> None:
    """Replace the only line of a file that matches a pattern."""
    text, count = re.subn(pattern, line, file.read_text(encoding="utf-8"), flags=re.MULTILINE)
    if count != 1:
        raise SystemExit(f"{file.name}: {count} lines match {pattern}, expected one")
    file.write_text(text, encoding="utf-8", newline="\n")


def tag_version(root: Path, version: str) -> None:
    """Write the version, and commit and tag it."""
    write_version(root, version)
    run_git(root, "commit", "--all", "--message", f"Release {version}")
    run_git(root, "tag", "--annotate", f"v{version}", "--message", f"Release {version}")


def run_git(root: Path, *words: str) -> str:
    """Run git in a folder; return what it prints."""
    done = subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def run_python(*words: str) -> None:
    """Run a module of Python; show what it says only if it fails."""
    done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(words[:2])}:\n{done.stdout}{done.stderr}")


if __name__ == "__main__":
    raise SystemExit(main())
