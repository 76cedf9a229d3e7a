"""Locks of a user: in a folder of this user alone, and no link is followed."""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from proofmass.base.errors import InputError
from proofmass.studies import locks, measure
from proofmass.studies.locks import announce_waiting, holder, is_private, open_lock, try_lock
from proofmass.studies.measure import describe_reservations, reserve_processor

LOCK_FOLDER = locks.lock_folder  # before a fixture of all tests replaces it
pytestmark = pytest.mark.skipif(not locks.HAS_LOCKS, reason="the system has no such locks")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files, of a user without a folder of the session."""
    monkeypatch.setattr(locks, "lock_folder", LOCK_FOLDER)
    monkeypatch.setattr(locks.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    return tmp_path / f"proofmass-{os.getuid()}"


def test_the_folder_is_one_that_the_user_alone_can_enter(folder, tmp_path, monkeypatch):
    assert LOCK_FOLDER() == LOCK_FOLDER() == folder
    assert folder.stat().st_mode & 0o777 == 0o700
    session = tmp_path / "session"
    session.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(session))
    assert LOCK_FOLDER() == session / "proofmass"
    session.chmod(0o755)
    assert LOCK_FOLDER() == folder


@pytest.mark.parametrize("kind", ["open", "link", "file", "others"])
def test_a_folder_that_somebody_else_prepared_is_refused(folder, tmp_path, monkeypatch, kind):
    if kind == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "elsewhere")
    elif kind == "file":
        folder.touch()
    else:
        folder.mkdir()
        folder.chmod(0o777 if kind == "open" else 0o700)
    if kind == "others":
        monkeypatch.setattr(locks, "is_private", lambda place, user: is_private(place, user + 1))
    with pytest.raises(InputError, match="you alone can enter"), reserve_processor():
        pass
    assert not list((tmp_path / "elsewhere").glob("*"))


def test_a_lock_file_that_is_a_link_is_not_followed(folder, tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("of the user")
    LOCK_FOLDER()
    for name in ("queue", "core-0"):
        (folder / name).symlink_to(victim)
        with pytest.raises(OSError, match="symbolic links"):
            open_lock(name)
    assert victim.read_text() == "of the user"


HOLD = """
import sys
from proofmass.studies import locks
locks.lock_folder = lambda: locks.Path(sys.argv[1])
kept = locks.try_lock("core-0")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_waiting_process_tells_who_has_the_processors(folder, monkeypatch, capsys):
    monkeypatch.setattr(measure, "available_processors", lambda: [0])
    assert describe_reservations() == ""
    command = [sys.executable, "-c", HOLD, str(LOCK_FOLDER())]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        assert try_lock("core-0") is None
        assert holder("core-0") == other.pid
        assert f"timed in process {other.pid} have" in describe_reservations()
        other.communicate("")
    assert holder("core-0") is None
    assert describe_reservations() == ""
    with reserve_processor() as core:
        assert core == 0
        assert holder("core-0") is None  # this process itself


def test_a_line_is_printed_once_for_all_that_wait_for_long(monkeypatch, capsys):
    monkeypatch.setattr(locks, "ANNOUNCE_SECONDS", 1e-3)
    told = locks.Event()

    def describe() -> str:
        calls.append(1)
        if len(calls) > 3:
            told.set()
        return "waiting for a test"

    for _ in range(2):
        calls = list[int]()
        told.clear()
        with announce_waiting(describe):
            assert told.wait(60)
    assert capsys.readouterr().err == "waiting for a test\n"
    with announce_waiting(lambda: ""):
        pass


@pytest.mark.skipif(os.name != "posix" or os.getuid() != 0, reason="needs the rights of root")
def test_a_user_without_an_account_can_reserve_a_processor():
    """As in ``docker run -u 12345``."""
    script = """
import os
from proofmass.studies.measure import reserve_processor
os.setgroups([])
os.setgid(12345)
os.setuid(12345)
with reserve_processor() as core:
    print(core is not None)
"""
    with TemporaryDirectory() as folder:  # that of a test is root's alone
        Path(folder).chmod(0o777)
        environment = {**os.environ, "TMPDIR": folder}
        environment.pop("XDG_RUNTIME_DIR", None)
        command = [sys.executable, "-c", script]
        found = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False
        )
        assert found.stdout == "True\n", found.stderr
        assert (Path(folder) / "proofmass-12345" / "queue").exists()
