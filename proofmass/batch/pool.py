"""Where calls run beside each other: in threads of this process, or on the workers of a cluster.

Each call that does work runs in a process of its own, see `proofmass.base.worker`; a thread only
waits for it.  A worker of a Dask cluster must compute with the same code and the same versions as
this process, or its numbers would be another program's.  This is asked of all workers at the start,
and of a worker before each call, since workers may join later.
"""

import os
import pickle
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import cache, partial
from typing import TYPE_CHECKING, Any, cast

from proofmass.base import installation
from proofmass.base.installation import describe_installation
from proofmass.base.worker import interrupt_workers

if TYPE_CHECKING:
    from distributed import Client

CONNECT_TIMEOUT = "10s"  # for the connection to a Dask scheduler
SILENT_SECONDS = 10.0
"""Time without any worker [s] after which a line says so.  Nothing depends on it but that line."""
LOOK_SECONDS = 0.5  # [s] between two looks whether there is a worker
MOST_DIFFERENCES = 3  # differences of an installation that are told


class ClusterError(ValueError):
    """The calls of a cluster cannot be made; the message says why."""


class OtherInstallation(ClusterError):
    """A worker computes with other code or other versions than this process."""


class LostCluster(ClusterError):
    """The cluster gave no answer to a call."""


@contextmanager
def pool(jobs: int | None = None, dask: str | None = None) -> Iterator[Executor]:
    """An executor for calls: `jobs` threads on this machine, one for each processor if not given.

    With `dask`, the address of a scheduler, calls go to a Dask cluster, whose workers need the same
    installation, and the files of the models at the same paths.  A line on standard error
    says so if the cluster has no worker.  An exception within the context, such as Ctrl-C, cancels
    all calls.

    Raises
    ------
    ClusterError
        Dask is not installed, no scheduler answers at the address, or a worker computes with other
        code or other versions.
    """
    with (
        interrupt_workers(),
        nullcontext() if dask is None else connect(dask) as client,
        (
            ThreadPoolExecutor(jobs or os.cpu_count())
            if client is None
            else Cluster(client, cast(str, dask))
        ) as executor,
    ):
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def size_of(executor: Executor) -> int:
    """The number of calls that a `pool` makes at the same time if its user did not say."""
    return executor.size if isinstance(executor, Cluster) else os.cpu_count() or 1


def connect(address: str) -> "Client":
    """Connect to the scheduler of a Dask cluster.

    Raises
    ------
    ClusterError
        Dask is not installed, or no scheduler answers at the address.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError("--dask needs dask: pip install proofmass[dask]") from None
    try:
        return Client(address, timeout=CONNECT_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"--dask {address}: no scheduler answers there, such as tcp://host:8786: {error}"
        ) from None


class Cluster(Executor):
    """The workers of a Dask cluster.

    Parameters
    ----------
    client : Client
    address : str
        Address of the scheduler, for messages.
    """

    def __init__(self, client: "Client", address: str) -> None:
        self.client, self.address = client, address
        self.own = describe_installation()
        self.wait_for_workers()
        self.compare_installations()
        self.calls = client.get_executor(pure=False)
        self.closed = threading.Event()
        # a daemon, since a question to a scheduler that is gone may never be answered
        threading.Thread(target=self.watch, daemon=True).start()

    @property
    def size(self) -> int:
        """The number of calls that run at the same time; at least 1."""
        return max(1, sum(self.client.nthreads().values()))

    def wait_for_workers(self) -> None:
        """Wait until there is a worker."""
        absence = Absence(self.address)
        while not absence.look(bool(self.client.nthreads())):
            time.sleep(LOOK_SECONDS)

    def watch(self) -> None:
        """Say a line whenever the last worker has been gone for a while."""
        absence = Absence(self.address)
        while not self.closed.wait(LOOK_SECONDS):
            try:
                absence.look(bool(self.client.nthreads()))
            except Exception:  # the scheduler is gone, which the calls report
                return

    def compare_installations(self) -> None:
        """Raise `OtherInstallation` if a worker's installation is not that of this process.

        The function that describes it is sent with its code, since the worker's proofmass may be
        another one.  Its code is Python's own, so that versions of Python are compared first.
        """
        import cloudpickle

        versions: Any = self.client.get_versions()
        for worker, one in versions["workers"].items():
            there = ".".join(one["host"]["python"].split(".")[:3])  # without "final.0"
            compare_installation({"Python": self.own["Python"]}, {"Python": there}, worker)
        cloudpickle.register_pickle_by_value(installation)
        try:
            asked = cloudpickle.dumps(Asked())
        finally:
            cloudpickle.unregister_pickle_by_value(installation)
        for worker, found in self.client.run(pickle.loads, asked).items():
            compare_installation(self.own, found, worker)

    def submit(self, function: Callable, /, *args: Any, **kwargs: Any) -> Future:
        """Call a function on a worker."""
        inner = self.calls.submit(call_if_same, self.own, function, args, kwargs)
        outer: Future = Future()
        outer.add_done_callback(lambda one: inner.cancel() if one.cancelled() else None)
        inner.add_done_callback(partial(self.pass_on, outer))
        return outer

    def pass_on(self, outer: Future, inner: Future) -> None:
        """Give the result of a call to the future that waits for it."""
        if inner.cancelled():
            outer.cancel()
        if not outer.set_running_or_notify_cancel():
            return
        error = inner.exception()
        if error is None:
            outer.set_result(inner.result())
        elif type(error).__module__.partition(".")[0] == "distributed":
            outer.set_exception(LostCluster(f"--dask {self.address}: {error}"))
        elif isinstance(error, ImportError | AttributeError):
            outer.set_exception(
                OtherInstallation(f"--dask {self.address}: a worker has another proofmass: {error}")
            )
        else:
            outer.set_exception(error)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the calls: wait for them, or cancel them."""
        self.closed.set()
        self.calls.shutdown(wait=wait and not cancel_futures)


class Absence:
    """The time for which a cluster has had no worker; a line says so once, after a while."""

    def __init__(self, address: str) -> None:
        self.address, self.since, self.told = address, time.monotonic(), False

    def look(self, there: bool) -> bool:
        """Note whether there is a worker, and return that."""
        if there:
            self.since, self.told = time.monotonic(), False
        elif not self.told and time.monotonic() - self.since > SILENT_SECONDS:
            self.told = True
            print(
                f"waiting: {self.address} has no worker; start one with "
                f"`dask worker {self.address}`, or end with Ctrl-C",
                file=sys.stderr,
            )
        return there


class Asked:
    """An object that becomes the description of an installation where it is unpacked."""

    def __reduce__(self) -> tuple[Callable, tuple]:
        return describe_installation, ()


@cache
def own_installation() -> dict[str, str]:
    """The installation of this process, at the first call: it has loaded this code."""
    return describe_installation()


def call_if_same(
    wanted: Mapping[str, str], function: Callable, args: tuple, kwargs: dict[str, Any]
) -> Any:
    """Call a function on a worker if its installation is the wanted one."""
    from distributed import get_worker

    compare_installation(wanted, own_installation(), get_worker().address)
    return function(*args, **kwargs)


def compare_installation(wanted: Mapping[str, str], found: Mapping[str, str], worker: str) -> None:
    """Raise `OtherInstallation` if a worker computes with something else than wanted.

    >>> compare_installation({"mujoco": "4.0.0"}, {"mujoco": "3.3.0"}, "tcp://a:1")
    Traceback (most recent call last):
      ...
    proofmass.batch.pool.OtherInstallation: worker tcp://a:1 computes with mujoco 3.3.0 instead of 4.0.0, so its numbers would be those of another program; install the same there and start it again
    """  # noqa: E501
    missing = installation.NOT_INSTALLED
    differs = [
        f"{name} {found.get(name, missing)} instead of {wanted.get(name, missing)}"
        for name in {**wanted, **found}
        if found.get(name, missing) != wanted.get(name, missing)
    ]
    if differs:
        raise OtherInstallation(
            f"worker {worker} computes with {', '.join(differs[:MOST_DIFFERENCES])}, so its "
            "numbers would be those of another program; install the same there and start it again"
        )
