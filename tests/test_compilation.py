"""What numba compiles is kept: a second process compiles nothing."""

import os
import subprocess
import sys

import pytest


def kept(folder) -> dict[str, float]:
    return {str(path): path.stat().st_mtime for path in folder.rglob("*.nb*")}


@pytest.mark.slow
def test_the_second_run_compiles_nothing(tmp_path):
    cache = tmp_path / "cache"

    def simulate(output: str) -> None:
        command = ["simulate", "rectangle", "--no-plots", "--set", "duration=0.5"]
        subprocess.run(
            [sys.executable, "-m", "mirte_drake", *command, "--output", str(tmp_path / output)],
            env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
            check=True,
            capture_output=True,
        )

    simulate("first")
    first = kept(cache)
    assert len(first) > 20
    simulate("second")
    assert kept(cache) == first
