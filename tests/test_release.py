"""One command builds, checks and tags a release; without an option it changes nothing."""

import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / ".ci" / "release.py"
PYPROJECT = """[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "small"
version = "0.1.0"
requires-python = ">=3.11"
description = "A small package"
readme = "README.md"

[tool.hatch.build.targets.wheel]
packages = ["small"]
"""
NOBODY = {
    f"GIT_{role}_{what}": "nobody@localhost"
    for role in ("AUTHOR", "COMMITTER")
    for what in ("NAME", "EMAIL")
}
"""Variables with which git needs no configuration."""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository of a small package, with the script."""
    files = {
        "pyproject.toml": PYPROJECT,
        "README.md": "# small\n",
        "CITATION.cff": "cff-version: 1.2.0\ntitle: small\nversion: 0.1.0\nlicense: MIT\n",
        "CHANGELOG.md": "# Changelog\n\n## 0.2.0\n\n- News.\n\n## 0.1.0\n",
        "small/__init__.py": "",
        ".gitignore": "dist/\n",
        ".ci/release.py": SCRIPT.read_text(encoding="utf-8"),
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "Begin"]):
        run(tmp_path, "git", *words)
    return tmp_path


def run(folder: Path, *words: str, code: int = 0) -> str:
    """Run a command that ends with an exit code; return what it prints."""
    environment = {**os.environ, **NOBODY, "GIT_CONFIG_GLOBAL": os.devnull}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def stated_version(folder: Path) -> str:
    """The version of a package by its pyproject.toml."""
    text = (folder / "pyproject.toml").read_text(encoding="utf-8")
    return str(tomllib.loads(text)["project"]["version"])


def release(folder: Path, *words: str, code: int = 0) -> str:
    """Run the script of a repository."""
    return run(folder, sys.executable, ".ci/release.py", *words, code=code)


def test_a_dry_run_builds_and_changes_nothing(repository: Path) -> None:
    text = release(repository, "0.2.0")
    assert "small-0.2.0-py3-none-any.whl\nsmall-0.2.0.tar.gz\n" in text
    assert "nothing was changed" in text
    assert run(repository, "git", "status", "--porcelain") == ""
    assert run(repository, "git", "tag") == ""
    assert not (repository / "dist").exists()


def test_a_release_has_one_version_in_all_places(repository: Path) -> None:
    release(repository, "0.2.0", "--make")
    assert stated_version(repository) == "0.2.0"
    citation = (repository / "CITATION.cff").read_text()
    assert re.search(r"\nversion: 0\.2\.0\ndate-released: \d{4}-\d\d-\d\d\nlicense", citation)
    assert run(repository, "git", "status", "--porcelain") == ""
    assert run(repository, "git", "describe", "--exact-match").strip() == "v0.2.0"
    (wheel,) = (repository / "dist").glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "small-0.2.0.dist-info/METADATA" in names
    assert "the tag v0.2.0 exists" in release(repository, "0.2.0", code=1)


def test_obstacles_are_named(repository: Path) -> None:
    assert "CHANGELOG.md has no section '## 0.3.0'" in release(repository, "0.3.0", code=1)
    assert "'next' is no version" in release(repository, "next", code=1)
    (repository / "README.md").write_text("# changed\n")
    assert "not committed" in release(repository, "0.2.0", code=1)


def test_a_readme_that_an_index_cannot_show_is_refused(repository: Path) -> None:
    text = PYPROJECT.replace("README.md", "README.rst")
    (repository / "pyproject.toml").write_text(text)
    (repository / "README.rst").write_text("Title\n=\n\n.. nothing:: \n")
    run(repository, "git", "add", ".")
    run(repository, "git", "commit", "-q", "-m", "Spoil the readme")
    assert "twine check" in release(repository, "0.2.0", code=1)


def test_version_and_citation_agree_and_the_changelog_has_the_version() -> None:
    version = stated_version(ROOT)
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {version}\n" in citation
    assert f"\n## {version}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_files_of_this_package_are_accepted(tmp_path: Path) -> None:
    if not (ROOT / ".git").exists() or not shutil.which("git"):
        pytest.skip("no repository")
    script = runpy.run_path(str(SCRIPT))
    wheel, source = script["build_files"](ROOT, "9.9.9", tmp_path)
    assert (wheel.name, source.name) == (
        "proofmass-9.9.9-py3-none-any.whl",
        "proofmass-9.9.9.tar.gz",
    )
