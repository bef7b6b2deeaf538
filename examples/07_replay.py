"""Makes a page that plays a run in 3-D: robot, reference, plan, tube, trails and wheel commands.

The page is one file that any browser opens without a network.

Prints:

    runs/example/own_path/replay.html, below 5 MB: True
"""

import sys
from pathlib import Path

from mirte_drake.replay import write_replay
from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run
from mirte_drake.scenario_file import load_scenario

FILE = Path(__file__).with_name("own_path.scenario.yaml")


def main(folder: Path) -> None:
    run = simulate(load_scenario(str(FILE)), "own_path")
    save_run(run, folder / "own_path")
    page = folder / "own_path" / "replay.html"
    write_replay(folder / "own_path", page)
    print(f"{page}, below 5 MB:", page.stat().st_size < 5e6)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example"))
