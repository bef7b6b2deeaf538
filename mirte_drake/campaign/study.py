"""Runs the trials of a campaign, and goes on where an earlier one ended."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from mirte_drake.campaign.grid import Trial
from mirte_drake.campaign.outcome import Failure, Outcome, run_outcome
from mirte_drake.campaign.store import load_result, save_result, scenario_key
from mirte_drake.campaign.workers import call_all


def run_trials(
    todo: Sequence[Trial],
    *,
    store: Path | None = None,
    backend: str = "loky",
    jobs: int = 1,
    address: str | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> list[Outcome | Failure]:
    """Runs trials and returns what each shows, in their order.

    Whatever happens to a run, the others go on. One that raised gives that error again; one whose
    process died is not stored, so that the same campaign tries it once more.

    Args:
        todo: What to run.
        store: Folder of the results of single runs; those in it are not run again.
        backend: One of ``workers.BACKENDS``.
        jobs: Number of runs at once.
        address: Of a running cluster.
        on_run: Called for each run, for a progress bar.

    Raises:
        UserError: when the backend cannot be used or the store cannot be written.
    """
    results: dict[int, Outcome | Failure] = {}
    keys = _keys(todo) if store is not None else []
    if store is not None:
        for leftover in store.glob(".partial-*"):  # Of a process that was killed.
            shutil.rmtree(leftover, ignore_errors=True)
        for index, key in enumerate(keys):
            stored = load_result(store, key)
            if stored is not None:
                results[index] = stored
                on_run()
    missing = [index for index in range(len(todo)) if index not in results]
    scenarios = [todo[index].scenario for index in missing]
    calls = call_all(run_outcome, scenarios, backend=backend, jobs=jobs, address=address)
    for position, result in calls:
        index = missing[position]
        if isinstance(result, Exception):
            result = Failure(" ".join(f"{type(result).__name__}: {result}".split()))
        elif store is not None:
            save_result(result, store, keys[index])
        results[index] = result
        on_run()
    return [results[index] for index in range(len(todo))]


def _keys(todo: Sequence[Trial]) -> list[str]:
    """Returns the name of every trial's result."""
    cells = {id(trial.cell): trial.cell for trial in todo}
    digests = {number: scenario_key(cell.scenario) for number, cell in cells.items()}
    return [f"{digests[id(trial.cell)]}-{trial.seed}" for trial in todo]
