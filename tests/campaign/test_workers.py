import os
import sys
from pathlib import Path

import numpy as np
import pytest
from worker_functions import square

from mirte_drake.campaign import workers
from mirte_drake.campaign.workers import call_all
from mirte_drake.errors import UserError


def results(arguments, **options) -> list:
    """Returns the results in the order of the arguments."""
    return [result for _, result in sorted(call_all(square, arguments, **options), key=index)]


def index(pair) -> int:
    return pair[0]


def values(arguments, **options) -> list[float]:
    return [value for value, _ in results(arguments, **options)]


@pytest.mark.parametrize("backend", ["serial", "loky"])
def test_every_argument_is_called_once(backend):
    numbers = [3.0, 1.0, 4.0, 1.0, 5.0]
    assert values(numbers, backend=backend, jobs=2) == [9.0, 1.0, 16.0, 1.0, 25.0]


def test_serial_calls_in_this_process_and_loky_in_as_many_as_asked_for():
    serial, loky = (
        {process for _, process in results(list(np.arange(8.0)), backend=backend, jobs=2)}
        for backend in ("serial", "loky")
    )
    assert serial == {os.getpid()}
    assert len(loky) == 2 and os.getpid() not in loky


@pytest.mark.parametrize("backend", ["serial", "loky"])
def test_a_call_that_raises_leaves_the_others_alone(backend):
    one, raised, other = results([1.0, -2.0, 3.0], backend=backend, jobs=2)
    assert isinstance(raised, ValueError) and str(raised) == "-2.0 is negative"
    assert (one[0], other[0]) == (1.0, 9.0)


def test_a_process_that_dies_takes_no_other_call_along():
    *others, last = results([1.0, np.nan, 2.0, np.nan, 3.0], jobs=2)
    assert isinstance(others[1], Exception) and isinstance(others[3], Exception)
    assert "terminated" in str(others[1])
    assert [others[0][0], others[2][0], last[0]] == [1.0, 4.0, 9.0]


def test_processes_are_replaced_after_a_number_of_calls(monkeypatch):
    monkeypatch.setattr(workers, "BATCH", 2)
    processes = [process for _, process in results(list(np.arange(5.0)), jobs=1)]
    assert processes[0] == processes[1] != processes[2] == processes[3] != processes[4]


def test_no_process_stays_behind():
    processes = {process for _, process in results(list(np.arange(4.0)), jobs=2)}
    for process in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_processes_end_when_nobody_waits_for_their_results():
    calls = call_all(square, list(np.arange(20.0)), jobs=2)
    _, (_, process) = next(calls)
    calls.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_dask_on_a_local_cluster():
    pytest.importorskip("distributed", reason="Dask is optional: mirte-drake[dask]")
    one, raised, other = results([1.0, -2.0, 3.0], backend="dask", jobs=2)
    assert isinstance(raised, ValueError) and (one[0], other[0]) == (1.0, 9.0)
    assert one[1] != os.getpid()


def test_dask_on_a_cluster_that_runs():
    distributed = pytest.importorskip("distributed", reason="Dask is optional: mirte-drake[dask]")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        assert values([2.0, 3.0], backend="dask", jobs=4, address=address) == [4.0, 9.0]


@pytest.mark.slow  # 10 s to start.
def test_ray_on_a_local_cluster(monkeypatch):
    pytest.importorskip("ray", reason="Ray is optional: mirte-drake[ray]")
    # Its processes know what is installed, which this module is not.
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    one, raised, died, other = results([1.0, -2.0, np.nan, 3.0], backend="ray", jobs=2)
    assert isinstance(raised, ValueError) and isinstance(died, Exception)
    assert (one[0], other[0]) == (1.0, 9.0)
    assert one[1] != os.getpid()


@pytest.mark.parametrize(("backend", "package"), [("dask", "distributed"), ("ray", "ray")])
def test_missing_package_is_named_with_its_remedy(backend, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    hint = f"needs the package {package}: pip install mirte-drake\\[{backend}\\]"
    with pytest.raises(UserError, match=hint):
        results([1.0], backend=backend)


def test_no_scheduler_at_the_address_is_one_clear_line():
    distributed = pytest.importorskip("distributed", reason="Dask is optional: mirte-drake[dask]")
    import dask

    assert distributed
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "0.2s"}),
        pytest.raises(UserError, match=r"^--address tcp://127\.0\.0\.1:9: no Dask scheduler"),
    ):
        results([1.0], backend="dask", address="tcp://127.0.0.1:9")
