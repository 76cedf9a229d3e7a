"""Calls on the workers of a real Dask cluster: the same installation, another, lost workers."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from proofmass.base.installation import describe_installation, digest_files, files_of
from proofmass.batch import pool as pool_module
from proofmass.batch.pool import (
    LostCluster,
    OtherInstallation,
    compare_installation,
    pool,
    size_of,
)
from proofmass.commands.cli import app

pytestmark = pytest.mark.skipif(  # not imported here, since its import takes as long as all others
    find_spec("distributed") is None, reason="distributed is not installed"
)
ROOT = Path(__file__).parents[2]


@pytest.fixture
def empty_cluster() -> Iterator[Any]:
    """A scheduler without a worker."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster


def run_command(*words: object) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words])


def double(number: int) -> int:
    return 2 * number


def die_once(marker: Path) -> str:
    """Kill the worker at the first call."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def die(marker: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_an_installation_is_described_by_versions_and_code(tmp_path):
    found = describe_installation()
    assert found["Python"] == ".".join(map(str, sys.version_info[:3]))
    for name in ("mujoco", "numpy", "pymunk", "scipy", "proofmass"):
        assert found[name][0].isdigit(), name
    assert "proofmass/batch/pool.py" in files_of("proofmass")
    (tmp_path / "a.py").write_text("x = 1\n")
    files = {"a.py": tmp_path / "a.py"}
    before = digest_files(files)
    assert digest_files({"b.py": tmp_path / "a.py"}) != before, "a name is part of the code"
    (tmp_path / "a.py").write_text("x = 2\n")
    assert digest_files(files) != before


def test_all_that_differs_is_named_with_both_sides():
    here = {"Python": "3.11.7", "mujoco": "4.0.0", "engine": "1.0, code 1"}
    compare_installation(here, dict(here), "tcp://a:1")
    with pytest.raises(OtherInstallation) as told:
        compare_installation(here, {"Python": "3.11.7", "mujoco": "3.3.0"}, "tcp://a:1")
    text = "worker tcp://a:1 computes with mujoco 3.3.0 instead of 4.0.0, engine none instead of"
    assert text in str(told.value)


def test_the_same_installation_computes(address):
    with pool(dask=address) as cluster:
        assert size_of(cluster) == 2
        assert list(cluster.map(double, [1, 2, 3])) == [2, 4, 6]


def test_each_call_asks_its_worker_what_it_computes_with(address):
    """A worker that joins after the start is asked as well."""
    with pool(dask=address) as cluster:
        cluster.own = {**cluster.own, "mujoco": "3.2.1"}
        with pytest.raises(OtherInstallation, match=r"mujoco 4\.\S+ instead of 3\.2\.1"):
            cluster.submit(double, 1).result()


def other_worker(folder: Path, address: str, package: bool) -> subprocess.Popen:
    """Start a worker with a changed copy of proofmass, or without any."""
    folder.mkdir()
    if package:
        shutil.copytree(ROOT / "proofmass", folder / "proofmass")
        with (folder / "proofmass" / "units.py").open("a") as file:
            file.write("\n# changed\n")
    else:
        (folder / "proofmass.py").write_text("raise ImportError('no proofmass here')\n")
    script = "from distributed.cli.dask_worker import main; main()"
    options = [address, "--no-nanny", "--no-dashboard", "--nthreads", "1"]
    return subprocess.Popen(
        [sys.executable, "-c", script, *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@pytest.mark.parametrize("package", [True, False], ids=["other code", "no proofmass"])
def test_a_worker_with_another_installation_is_refused_before_the_first_call(
    empty_cluster, tmp_path, package
):
    address = empty_cluster.scheduler_address
    worker = other_worker(tmp_path / "other", address, package)
    try:
        answer = run_command("check", ROOT / "models/linkages/pendulum.toml", "--dask", address)
    finally:
        worker.kill()
        worker.wait()
    assert answer.exit_code == 2
    message = " ".join(answer.output.split())
    assert "error: worker tcp://" in message
    assert f"instead of {describe_installation()['proofmass']}" in message


def test_a_cluster_without_a_worker_is_told_and_waited_for(empty_cluster, monkeypatch, capsys):
    def start_worker(_: float) -> None:
        told.append(capsys.readouterr().err)
        if told[-1]:
            empty_cluster.scale(1)
        sleep(0.05)

    told, sleep = [], time.sleep
    monkeypatch.setattr(pool_module, "SILENT_SECONDS", 0.0)
    monkeypatch.setattr(pool_module.time, "sleep", start_worker)
    with pool(dask=empty_cluster.scheduler_address) as cluster:
        assert cluster.submit(double, 4).result() == 8
    (line,) = filter(None, told)
    assert f"{empty_cluster.scheduler_address} has no worker; start one with" in line


def test_one_interrupt_ends_the_wait_for_a_worker(empty_cluster, monkeypatch):
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pool_module.time, "sleep", interrupt)
    with pytest.raises(KeyboardInterrupt), pool(dask=empty_cluster.scheduler_address):
        pass


def test_one_interrupt_cancels_the_calls_of_a_cluster(address):
    calls = []

    def interrupted() -> None:
        calls.extend(cluster.submit(time.sleep, 1.0) for _ in range(8))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), pool(dask=address) as cluster:
        interrupted()
    assert sum(call.cancelled() for call in calls) >= 6, "all but those that two workers run"


def test_the_call_of_a_worker_that_dies_runs_again(address, tmp_path):
    with pool(dask=address) as cluster:
        assert cluster.submit(die_once, tmp_path / "marker").result() == "done"


def test_a_call_that_kills_its_workers_is_an_error_in_one_line(tmp_path):
    """The scheduler gives a call up at the first death here, and by default at the fourth."""
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster,
        pool(dask=cluster.scheduler_address) as calls,
        pytest.raises(LostCluster) as told,
    ):
        calls.submit(die, tmp_path).result()
    assert f"--dask {cluster.scheduler_address}: " in str(told.value)
    assert "\n" not in str(told.value)


def test_check_gives_the_same_on_a_cluster(address):
    models = [ROOT / "models/linkages/pendulum.toml", ROOT / "models/linkages/no_such.toml"]
    here, there = (
        json.loads(run_command("check", *models, "--json", *options).stdout)
        for options in ([], ["--dask", address])
    )
    for one in (here, there):
        for row in one["comparisons"]:
            row.pop("seconds")
    assert here == there
    assert here["comparisons"]
    assert here["errors"]
