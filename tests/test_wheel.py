"""An installed wheel has all it needs: models and scenarios travel with it."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_wheel_runs_a_scenario_outside_the_source(tmp_path):
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", tmp_path, ROOT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "mirte_drake/diagrams/rectangle.scenario.yaml" in names
    assert "mirte_drake/model/identified/extended_kinematic.yaml" in names
    assert "mirte_drake/visualization/replay_overlay.html" in names
    assert not [name for name in names if name.startswith(("tests", "examples"))]

    site, folder = tmp_path / "site", tmp_path / "elsewhere"
    folder.mkdir()
    install = [*pip, "install", "--no-deps", "--target", site, wheel]
    subprocess.run(install, check=True, capture_output=True)
    code = (
        "import mirte_drake, mirte_drake.cli as c; print(mirte_drake.__file__); "
        "c.main(['simulate', 'rectangle', '--set', 'duration=1', '--replay'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(site))
    for name in ("summary.json", "replay.html"):
        assert (folder / "runs" / "rectangle" / name).is_file()
