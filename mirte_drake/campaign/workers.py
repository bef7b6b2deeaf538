"""Many calls at once: in this process, in processes of this machine, or on a cluster."""

import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any

from mirte_drake.errors import UserError

# Calls that a process serves. Python systems hold their Diagram by their callbacks, so that it is
# never freed: 1 to 3 MB stay with the process after each run.
BATCH = 50
# [s] After which a process without work ends, as when this one was killed. It then waits for this
# one's consent, in vain, for 30 s more.
IDLE_TIME = 10.0
ORPHAN_TIME = IDLE_TIME + 30.0
# The matrices are small: threads only get in each other's way.
ENVIRONMENT = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}

Submit = Callable[[Callable, Any], Future]


def call_all(
    function: Callable[[Any], Any],
    arguments: Sequence[Any],
    *,
    backend: str = "loky",
    jobs: int = 1,
    address: str | None = None,
) -> Iterator[tuple[int, Any]]:
    """Calls a function with each argument; yields index and result as they come.

    Args:
        function: At the top of a module, so that other processes find it.
        arguments: What to call it with; each can be pickled.
        backend: One of ``BACKENDS``.
        jobs: Number of calls at once.
        address: Of a running Dask scheduler or Ray cluster; None starts one on this machine.

    Yields:
        Where the call raised, or the process died in which it ran, the exception is the result.

    Raises:
        UserError: when the backend's package is missing, or there is nothing at the address.
    """
    if not arguments:
        return
    with BACKENDS[backend](jobs, address) as submit:
        waiting: dict[Future, int] = {}
        for index, argument in enumerate(arguments):
            if len(waiting) >= jobs:
                yield from _completed(waiting)
            waiting[submit(function, argument)] = index
        while waiting:
            yield from _completed(waiting)


def _completed(waiting: dict[Future, int]) -> Iterator[tuple[int, Any]]:
    """Waits for at least one call, takes those that are done out and yields them."""
    done, _ = wait(waiting, return_when=FIRST_COMPLETED)
    for future in done:
        try:
            error = future.exception()
        except CancelledError as cancelled:  # As by a cluster that was shut down.
            error = cancelled
        if isinstance(error, KeyboardInterrupt):
            raise error
        yield waiting.pop(future), error or future.result()


@contextmanager
def _serial(jobs: int, address: str | None) -> Iterator[Submit]:
    """Calls in this process, one after another."""

    def submit(function: Callable, argument: Any) -> Future:  # noqa: ANN401
        future: Future = Future()
        try:
            future.set_result(function(argument))
        except Exception as error:
            future.set_exception(error)
        return future

    yield submit


@contextmanager
def _loky(jobs: int, address: str | None) -> Iterator[Submit]:
    """Calls in processes of this machine, each replaced after ``BATCH`` calls or when it dies.

    Each belongs to a thread of its own, so that one that dies takes no other's call along.
    """
    from loky import ProcessPoolExecutor
    from loky.process_executor import BrokenProcessPool

    mine = threading.local()
    threads = ThreadPoolExecutor(jobs)
    with ExitStack() as stack:
        stack.callback(threads.shutdown)

        def call(function: Callable, argument: Any) -> Any:  # noqa: ANN401
            if getattr(mine, "calls", BATCH) == BATCH:
                if hasattr(mine, "process"):
                    mine.process.shutdown()
                mine.process = ProcessPoolExecutor(1, timeout=IDLE_TIME, env=ENVIRONMENT)
                # Before the threads are waited for: an interruption ends calls that run.
                stack.callback(mine.process.shutdown, kill_workers=True)
                mine.calls = 0
            mine.calls += 1
            try:
                return mine.process.submit(function, argument).result()
            except BrokenProcessPool:
                mine.calls = BATCH
                raise

        yield lambda function, argument: threads.submit(call, function, argument)


@contextmanager
def _dask(jobs: int, address: str | None) -> Iterator[Submit]:
    """Calls on a Dask cluster, where this package is installed too.

    Its workers keep what a run leaves behind: start those of a long campaign with
    ``--lifetime`` and ``--lifetime-restart``.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise UserError(
            "--backend dask: needs the package distributed: pip install mirte-drake[dask]"
        ) from None
    with ExitStack() as stack:
        place: Any = address
        if address is None:
            # None: without a page for a browser.
            cluster = LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
            place = stack.enter_context(cluster)
        try:
            client = stack.enter_context(Client(place))
        except (OSError, ValueError) as error:
            raise UserError(f"--address {address}: no Dask scheduler: {error}") from None
        yield client.get_executor(pure=False).submit


@contextmanager
def _ray(jobs: int, address: str | None) -> Iterator[Submit]:
    """Calls on a Ray cluster, where this package is installed too."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise UserError(
            "--backend ray: needs the package ray: pip install mirte-drake[ray]"
        ) from None
    where: dict[str, Any] = {"address": address}
    if address is None:
        where = {"address": "local", "num_cpus": jobs, "include_dashboard": False}
        where["_node_ip_address"] = "127.0.0.1"  # Nobody else can reach it.
    try:
        ray.init(logging_level=logging.ERROR, log_to_driver=False, **where)
    except (ConnectionError, ValueError) as error:
        raise UserError(f"--address {address}: no Ray cluster: {error}") from None
    try:
        call = ray.remote(num_cpus=1, max_calls=BATCH, max_retries=0)(_call)
        yield lambda function, argument: call.remote(function, argument).future()
    finally:
        ray.shutdown()


def _call(function: Callable, argument: Any) -> Any:  # noqa: ANN401
    return function(argument)


BACKENDS: dict[str, Callable[[int, str | None], AbstractContextManager[Submit]]] = {
    "loky": _loky,
    "serial": _serial,
    "dask": _dask,
    "ray": _ray,
}
