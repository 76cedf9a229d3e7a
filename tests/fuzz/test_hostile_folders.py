"""Hostile folders and arguments by numbered seeds: nothing of theirs runs or is overwritten.

Each seed makes a folder of a stranger with some of `TRAPS`, and gives one of `COMMANDS` in it, with
an output that is an input, a file of the user or a link to one.  A program that should not run
leaves a file; files of the user and of the stranger are compared before and after.
"""

import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.shipped import shipped

SEEDS, SAMPLE = range(200), (0, 2, 4, 5, 11, 14)
"""All seeds, and those that run by default, whose commands are no studies."""
OUTPUT_ENDINGS = (".toml", ".xml", ".html", ".json", ".csv", ".py", ".gif", "")
Trap = Callable[["Stranger"], None]


class Pickled:
    """What runs code when it is loaded from a pickle."""

    def __init__(self, code: str) -> None:
        self.code = code

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return exec, (self.code,)


class Stranger:
    """A stranger's folder, files of the user beside it, and a program that should not run."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.random = random.Random(seed)
        self.ran, self.victims = folder / "ran", folder / "victims"
        self.place, self.programs = folder / "strange", folder / "programs"
        self.code = f"open({str(self.ran)!r}, 'a').write('python')"
        for each in (self.victims, self.place, self.programs, folder / "home", folder / "tmp"):
            each.mkdir()
        for k, ending in enumerate(OUTPUT_ENDINGS):
            (self.victims / f"mine{ending}").write_text(f"file {k} of the user\n")
        for name in ("git", "latex", "pdflatex", "canary"):
            self.write_program(self.programs / name)
        for ending in ("xml", "toml"):
            text = shipped(f"pendulum.{ending}").read_text(encoding="utf-8")
            text = text.replace("until = 10.0", "until = 0.1").replace("n = 1001", "n = 11")
            (self.place / f"case.{ending}").write_text(text, encoding="utf-8")
        (self.place / "wanted.csv").write_text("angle [deg],moment [1]\n0,0\n90,1\n180,0\n")
        for trap in self.random.sample(TRAPS, 5):
            trap(self)

    def write_program(self, file: Path) -> None:
        """Write a program that leaves a file if it runs."""
        file.write_text(f"#!/bin/sh\necho {file.name} >> '{self.ran}'\n")
        file.chmod(0o755)

    def replace(self, ending: str, old: str, new: str) -> None:
        """Replace a text in the sidecar or in the model."""
        file = self.place / f"case.{ending}"
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new, 1), encoding="utf-8")

    def link(self, name: str, to: Path) -> None:
        """Make a link in the folder, unless its name is taken."""
        if not os.path.lexists(self.place / name):
            (self.place / name).symlink_to(to)

    def victim(self) -> Path:
        """One of the user's files."""
        return self.victims / f"mine{self.random.choice(OUTPUT_ENDINGS)}"

    def command(self) -> list[str]:
        """A command, with an output that must not be written to."""
        words, ending = self.random.choice(COMMANDS)
        inputs = [self.place / "case.toml", self.place / "case.xml"]
        outputs = [*inputs, self.victims / f"mine{ending}", self.place / f"out{ending}"]
        self.link(f"out{ending}", self.victim())
        out = self.random.choice(outputs)
        forced = "-o" in words or "--junit" in words or "--sarif" in words
        force = ["--force"] if forced and out in inputs else []
        return [word.format(out=out) for word in words] + force * self.random.randrange(2)

    def state(self) -> dict[str, object]:
        """All files of the user and the stranger, and where links lead."""
        found: dict[str, object] = {}
        for folder in (self.victims, self.place):
            for file in sorted(folder.rglob("*")):
                if file.is_symlink():
                    found[str(file)] = os.readlink(file)
                elif file.is_file():
                    found[str(file)] = file.read_bytes()
        return found


def shadow_modules(s: Stranger) -> None:
    """Modules that Python would import from the current folder."""
    for name in ("sitecustomize", "usercustomize", "conftest", "mujoco", "pint", "evil", "scipy"):
        (s.place / f"{name}.py").write_text(s.code)


def bring_an_engine(s: Stranger) -> None:
    """An installed engine, as far as the metadata in the folder say."""
    info = s.place / "evil-1.0.dist-info"
    info.mkdir()
    (s.place / "evil.py").write_text(s.code)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[proofmass.engines]\nmujoco = evil:ENGINE\n")


def name_programs_in_git(s: Stranger) -> None:
    """A repository whose settings name programs."""
    (s.place / ".git" / "refs" / "heads").mkdir(parents=True)
    (s.place / ".git" / "objects").mkdir()
    program = s.programs / "canary"
    text = (
        f'[core]\nfsmonitor = {program}\nsshCommand = {program}\n[filter "x"]\nclean = {program}\n'
    )
    (s.place / ".git" / "config").write_text(text)
    head = s.random.choice(["ref: refs/heads/a\n", "ref: ../../victims/mine\n", "0" * 40])
    (s.place / ".git" / "HEAD").write_text(head)
    (s.place / ".gitattributes").write_text("* filter=x\n")


def set_figures(s: Stranger) -> None:
    """Settings of matplotlib that start LaTeX and name a module."""
    text = "text.usetex: True\nbackend: module://evil\n"
    (s.place / "matplotlibrc").write_text(text)
    (s.place / "evil.py").write_text(s.code)


def link_outputs(s: Stranger) -> None:
    """Links to files of the user under the names of outputs."""
    for name in ("case.webp", "case.gif", "MUJOCO_LOG.TXT", ".proofmass", "results.json"):
        s.link(name, s.victim())


def link_folders(s: Stranger) -> None:
    """Links to the user's folder under the names of folders that commands write to."""
    for name in s.random.sample(["reports", "trade", "diet", "design", "stress"], 3):
        s.link(name, s.victims)


def link_inside_of_studies(s: Stranger) -> None:
    """Folders for the studies that have links to the user's folder and files under their names."""
    for name in ("trade", "stress", "design"):
        if os.path.lexists(s.place / name):
            continue
        (s.place / name).mkdir()
        for folder in ("runs", "report", "static", "figures"):
            (s.place / name / folder).symlink_to(s.victims)
        for file in (
            "index.html",
            "search.npz",
            "design.json",
            "balancer_sine.toml",
            f"{name}.csv",
        ):
            (s.place / name / file).symlink_to(s.victim())


def leave_a_search_with_code(s: Stranger) -> None:
    """States of a search and stored runs with pickled code, which loading them would run."""
    code = np.array([Pickled(s.code)], dtype=object)
    for name in ("design", "trade", "stress"):
        folder = s.place / name
        if folder.is_symlink():
            continue
        (folder / "work").mkdir(parents=True, exist_ok=True)
        for file in (folder / "search.npz", folder / "work" / "run.npz"):
            if not os.path.lexists(file):
                np.savez(file, key=code, x=code, found=code)


def link_inside_of_a_report(s: Stranger) -> None:
    """A folder for the report that has links to the user's folder, and files of the user."""
    if os.path.lexists(s.place / "reports"):
        return
    (s.place / "reports").mkdir()
    for name in s.random.sample(["figures", "static", "data"], 2):
        (s.place / "reports" / name).symlink_to(s.victims)
    (s.place / "reports" / "case.html").symlink_to(s.victim())


def write_code_into_names(s: Stranger) -> None:
    """Code in the words of the sidecar, as it would end a string or a comment."""
    quote = s.random.choice(['\\"\\"\\"', "'''", "\\n", "{{", "</script>"])
    s.replace("toml", 'title = "', f'title = "{quote}\\n{s.code}\\n{quote} ')


def use_external_entities(s: Stranger) -> None:
    """An entity of XML that names a file of the user."""
    entity = f'<!DOCTYPE m [<!ENTITY x SYSTEM "file://{s.victims}/mine">]>'
    s.replace("xml", "<mujoco", f"{entity}<mujoco")


def include_files_of_the_user(s: Stranger) -> None:
    """An include, a mesh and a plugin from outside of the folder."""
    more = s.random.choice(
        [
            '<include file="../victims/mine.xml"/>',
            '<asset><mesh name="m" file="../victims/mine"/></asset>',
            '<extension><plugin plugin="../programs/canary"/></extension>',
            '<asset><model name="m" file="case.xml"/></asset>',
        ]
    )
    s.replace("xml", "</mujoco>", f"{more}</mujoco>")


def compare_with_a_file_of_the_user(s: Stranger) -> None:
    """A recorded reference outside of the folder."""
    (s.place / "recorded.toml").write_text(
        'title = "a"\nsource = "b"\nmodel = "case.xml"\nreference = "../victims/mine.csv"\n'
        '[run.dynamics]\nsolvers = ["mujoco"]\n'
    )


def wait_on_pipes(s: Stranger) -> None:
    """Pipes under the names of files that are read."""
    for name in ("pipe.toml", "pipe.xml", "trade.csv"):
        os.mkfifo(s.place / name)


TRAPS: list[Trap] = [
    shadow_modules,
    bring_an_engine,
    name_programs_in_git,
    set_figures,
    link_outputs,
    link_folders,
    link_inside_of_studies,
    leave_a_search_with_code,
    link_inside_of_a_report,
    write_code_into_names,
    use_external_entities,
    include_files_of_the_user,
    compare_with_a_file_of_the_user,
    wait_on_pipes,
]
COMMANDS = (
    (["check", ".", "--junit", "{out}"], ".xml"),
    (["check", "case.toml", "--sarif", "{out}"], ".json"),
    (["report", "case.toml", "-o", "{out}"], ""),
    (["report", ".", "--data"], ""),
    (["schema", "-o", "{out}"], ".json"),
    (["animate", "case.toml", "--frames", "2", "-o", "{out}"], ".gif"),
    (["animate", "case.xml", "--frames", "2"], ".gif"),
    (["choose", "case.toml", "--error", "1e-3", "-o", "{out}"], ".py"),
    (["diet", "case.xml", "-o", "{out}"], ".xml"),
    (["new", "case", "--from", "case.xml"], ".toml"),
    (["list", "."], ""),
    (["show", "case.toml"], ""),
    (["trade", "case.toml", "--longest", "0.02", "-o", "{out}"], ""),
    (["trade", ".", "--longest", "0.02"], ""),
    (["stress", "case.toml", "--only", "gravity", "-o", "{out}"], ""),
    (["stress", ".", "--only", "gravity"], ""),
    (["design", "balancer", "--effort", "0.05", "-o", "{out}"], ""),
    (["design", "balancer", "--effort", "0.05", "--table", "wanted.csv"], ""),
)
"""Words of commands, and the ending of the file that they write."""


@pytest.mark.parametrize(
    "seed",
    [pytest.param(k, marks=[pytest.mark.slow] * (k not in SAMPLE)) for k in SEEDS],
)
def test_a_hostile_folder_runs_nothing_and_overwrites_nothing(seed, tmp_path):
    stranger = Stranger(tmp_path, seed)
    command, before = stranger.command(), stranger.state()
    found = subprocess.run(
        [sys.executable, "-m", "proofmass", *command],
        cwd=stranger.place,
        env={
            **os.environ,
            "PATH": f"{stranger.programs}{os.pathsep}{os.environ['PATH']}",
            "HOME": str(tmp_path / "home"),
            "XDG_CACHE_HOME": str(tmp_path / "home"),
            "TMPDIR": str(tmp_path / "tmp"),
        },
        capture_output=True,
        timeout=600,
        check=False,
    )
    told = f"{command}\n{found.stdout.decode()}{found.stderr.decode()}"
    assert not stranger.ran.exists(), f"{stranger.ran.read_text()} ran: {told}"
    assert found.returncode in (0, 1, 2), told
    assert "Traceback" not in told
    after = stranger.state()
    lost = [file for file, content in before.items() if after.get(file) != content]
    assert not lost, told
    new = [file for file in after.keys() - before.keys() if file.startswith(str(stranger.victims))]
    assert not new, told
