"""Keeps the result of every run in a file of its own, so that a campaign that was killed goes on.

A result is found again by all that it depends on: the complete scenario, the files that it names,
the program and the versions below it. So it is used again where it holds, and nowhere else.
"""

import dataclasses as dc
import functools
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

import mirte_drake
from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.files import write_json
from mirte_drake.run_summary import versions
from mirte_drake.scenario import Scenario


def scenario_key(scenario: Scenario) -> str:
    """Returns a digest of all that the results of a scenario depend on, but for its seed."""
    digest = hashlib.sha256(_program().encode())
    digest.update(yaml_dump_typed(dc.replace(scenario, description="", seed=0)).encode())
    for path in sorted(_named_files(scenario)):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:32]


@functools.cache
def _program() -> str:
    """Returns a digest of this package and the versions of what it stands on."""
    digest = hashlib.sha256(json.dumps(versions()).encode())
    folder = Path(mirte_drake.__file__).parent
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".py", ".yaml"):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _named_files(value: object) -> Iterator[Path]:
    """Yields the files that a value names, however deep within it."""
    if dc.is_dataclass(value):
        for field in dc.fields(value):
            yield from _named_files(getattr(value, field.name))
    elif isinstance(value, list):
        for item in value:
            yield from _named_files(item)
    elif isinstance(value, str | Path) and Path(value).is_file():
        yield Path(value)


def save_result(result: Outcome | Failure, folder: Path, key: str) -> None:
    """Writes the result of a run, complete or not at all.

    Raises:
        UserError: when it cannot be written.
    """
    write_json({type(result).__name__: dc.asdict(result)}, folder / f"{key}.json")


def load_result(folder: Path, key: str) -> Outcome | Failure | None:
    """Returns the result of a run, or None where there is none that is whole."""
    try:
        ((kind, values),) = json.loads((folder / f"{key}.json").read_text("utf-8")).items()
        return {"Outcome": Outcome, "Failure": Failure}[kind](**values)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
