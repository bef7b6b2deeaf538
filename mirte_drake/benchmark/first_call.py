"""What the first solve of a fresh process costs: imports, construction, compilation."""

import itertools
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STAGES = ("import_s", "construction_s", "first_solve_s")


def first_call(
    name: str, problem: object, data: object, guess: object, *, compiled: bool = True
) -> dict[str, float]:
    """Returns the seconds that each of ``STAGES`` takes in a new process.

    Args:
        name: One of ``SOLVER_NAMES``.
        problem: The TrackingProblem.
        data: The TrackingData to solve.
        guess: The decision vector to begin from.
        compiled: False hides what earlier processes compiled, as after an installation.

    Raises:
        RuntimeError: when the process fails.
    """
    package = Path(__file__).parents[2]
    paths = [str(package), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    with tempfile.TemporaryDirectory() as empty:
        if not compiled:
            environment["NUMBA_CACHE_DIR"] = empty
        done = subprocess.run(
            [sys.executable, "-m", "mirte_drake.benchmark.first_call"],
            input=pickle.dumps((name, problem, data, guess)),
            capture_output=True,
            env=environment,
        )
    if done.returncode:
        lines = done.stderr.decode().strip().splitlines() or ["no message"]
        raise RuntimeError(f"first call in a fresh process failed: {lines[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def _main() -> None:
    request = sys.stdin.buffer.read()
    times = [time.perf_counter()]
    from mirte_drake.benchmark.solvers import make_solver

    # Unpickling imports what the problem is made of.
    name, problem, data, guess = pickle.loads(request)
    times.append(time.perf_counter())
    solver = make_solver(problem, name)
    times.append(time.perf_counter())
    solver.solve(data, guess)
    times.append(time.perf_counter())
    seconds = (end - start for start, end in itertools.pairwise(times))
    print(json.dumps(dict(zip(STAGES, seconds, strict=True))))


if __name__ == "__main__":
    _main()
