"""Reading and writing files: errors that a user can mend, and nothing half-written."""

import json
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mirte_drake.errors import UserError


def read_text(path: Path) -> str:
    """Returns the text of a file.

    Raises:
        UserError: when it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: cannot be read: it is not UTF-8 text") from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a temporary path of the same suffix that becomes ``path`` when the block succeeds.

    Raises:
        UserError: when the folder cannot be made or written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=path.parent) as folder:
            temporary = Path(folder) / path.name
            yield temporary
            temporary.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None


def write_json(value: object, path: Path) -> None:
    """Writes a JSON file, complete or not at all.

    Raises:
        UserError: when it cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")


@contextmanager
def replacing_results(folder: Path, owned: Iterable[str]) -> Iterator[Path]:
    """Yields a temporary folder whose files move into ``folder`` when the block succeeds.

    So a folder holds the results of one run, never of two.

    Args:
        folder: Where the files belong; made when missing.
        owned: Names of what an earlier run may have left there, which is removed; names, not
            patterns, so that nothing of the user's can match.

    Raises:
        UserError: when the folder cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=folder) as temporary:
            yield Path(temporary)
            for name in owned:
                (folder / name).unlink(missing_ok=True)
            for file in sorted(Path(temporary).iterdir()):
                file.replace(folder / file.name)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
