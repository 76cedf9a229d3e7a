"""Tests that a report reads the commit of a repository from its files, and runs nothing of it."""

import os
import subprocess
from pathlib import Path

import pytest

from proofmass import check
from proofmass.report import write_report
from proofmass.report.commit import commit_of
from tests.shipped import shipped


def git(folder: Path, *words: str) -> str:
    """Run git in a folder, without the user's settings, and return its output."""
    who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "protocol.file.allow=always"]
    return subprocess.run(
        ["git", "-C", str(folder), *who, *words],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"},
    ).stdout.strip()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A repository with a commit, and a folder ``below``."""
    folder = tmp_path / "tree"
    (folder / "below").mkdir(parents=True)
    (folder / "below" / "a.toml").write_text("x = 1")
    git(folder, "init", "-q", "-b", "main/line")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "one")
    return folder


def test_the_commit_is_the_one_that_git_names(tree, tmp_path):
    commit = git(tree, "rev-parse", "HEAD")
    assert commit_of(tmp_path) == ""
    for place in (tree, tree / "below", tree / "below" / "a.toml"):
        assert commit_of(place) == commit
    git(tree, "pack-refs", "--all")
    assert not (tree / ".git" / "refs" / "heads" / "main" / "line").exists()
    assert commit_of(tree) == commit


def test_a_detached_head_and_other_working_trees_have_their_own_commit(tree, tmp_path):
    first = git(tree, "rev-parse", "HEAD")
    git(tree, "commit", "-q", "--allow-empty", "-m", "two")
    git(tree, "worktree", "add", "-q", "-b", "other", str(tmp_path / "other"), first)
    assert commit_of(tmp_path / "other" / "below") == first
    git(tree, "pack-refs", "--all")
    assert commit_of(tmp_path / "other" / "below") == first
    assert commit_of(tree) == git(tree, "rev-parse", "HEAD") != first
    git(tree, "checkout", "-q", "--detach", first)
    assert commit_of(tree) == first


def test_a_submodule_has_its_own_commit(tree, tmp_path):
    outer = tmp_path / "outer"
    outer.mkdir()
    git(outer, "init", "-q")
    git(outer, "submodule", "--quiet", "add", str(tree), "inner")
    git(outer, "commit", "-q", "-m", "outer")
    assert (outer / "inner" / ".git").is_file()
    assert commit_of(outer / "inner") == git(tree, "rev-parse", "HEAD")
    assert commit_of(outer) == git(outer, "rev-parse", "HEAD") != commit_of(outer / "inner")


@pytest.mark.parametrize(
    "head", ["ref: refs/../../secret", "secret", "ref: /etc/hostname", "", "ref: refs/heads/none"]
)
def test_no_text_that_is_not_a_commit_is_read(tree, head):
    (tree / "secret").write_text("not a commit")
    (tree / ".git" / "HEAD").write_text(f"{head}\n")
    assert commit_of(tree) == ""


def test_a_pipe_or_a_loop_of_links_is_not_read(tree):
    (tree / ".git" / "HEAD").unlink()
    os.mkfifo(tree / ".git" / "HEAD")  # reading it would wait for ever
    assert commit_of(tree) == ""
    (tree / ".git" / "HEAD").unlink()
    (tree / ".git" / "HEAD").symlink_to("HEAD")
    assert commit_of(tree) == ""


def test_a_report_on_a_strangers_repository_runs_no_program_of_it(tmp_path):
    """Git itself would run the program: to look for changed files, to read one, and to commit."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    for ending in ("toml", "xml"):
        file = shipped(f"pendulum.{ending}")
        (folder / file.name).write_bytes(file.read_bytes())
    git(folder, "init", "-q")
    (folder / ".gitattributes").write_text("*.xml filter=own\n")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "one")
    ran = tmp_path / "ran"
    program = folder / ".git" / "own.sh"
    program.write_text(f"#!/bin/sh\necho ran >> '{ran}'\ncat\n")
    program.chmod(0o755)
    git(folder, "config", "core.fsmonitor", str(program))
    git(folder, "config", "filter.own.clean", str(program))
    (folder / "pendulum.xml").touch()
    index = write_report(check([folder / "pendulum.toml"], causes=False), tmp_path / "report")
    assert commit_of(folder)[:7] in index.read_text(encoding="utf-8")
    assert not ran.exists()
    git(folder, "status")
    assert ran.exists(), "the program is one that git runs"
