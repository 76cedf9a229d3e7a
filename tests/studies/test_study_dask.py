"""Studies on a real Dask cluster of two processes on this machine."""

from concurrent.futures import Executor
from dataclasses import replace
from importlib.util import find_spec

import pytest

from proofmass.base.errors import InputError
from proofmass.batch.pool import pool
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from tests.studies.study_tasks import tasks

pytestmark = pytest.mark.skipif(  # not imported here, since its import takes as long as all others
    find_spec("distributed") is None, reason="distributed is not installed"
)


def results_without_times(store: Store, workers: Executor | None) -> list[tuple]:
    """The results of the tasks that do not depend on processor times."""
    return [
        (one.errors, one.invariants, one.steps, one.outcome, len(one.repeats))
        for one in Study(store, workers).run(tasks(), repeats=1)
    ]


@pytest.mark.slow
def test_a_cluster_gives_what_this_machine_gives(tmp_path, address):
    with pool(dask=address) as cluster:
        far = results_without_times(Store(tmp_path / "far"), cluster)
    assert far == results_without_times(Store(tmp_path / "here"), None)
    assert far == results_without_times(
        Store(tmp_path / "far"), None
    )  # the cluster stored them here


def test_both_workers_are_used(address):
    with pool(dask=address) as cluster:
        names = {
            future.result()
            for future in [cluster.submit(worker_address_after_pause) for _ in range(8)]
        }
    assert len(names) == 2


def worker_address_after_pause() -> str:
    """The address of the worker, after a pause in which the other worker takes a call."""
    import time

    import distributed

    time.sleep(0.2)
    return str(distributed.get_worker().address)


def test_bad_input_comes_back_from_a_cluster(tmp_path, address):
    wrong = replace(tasks()[0], setting=tasks()[0].setting.with_parameters(integrator="Simpson"))
    with pytest.raises(InputError, match="known: euler"), pool(dask=address) as cluster:
        Study(Store(tmp_path), cluster).run([wrong])
