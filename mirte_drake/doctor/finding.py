"""What a check of this machine comes to."""

import dataclasses as dc
import enum


class Grade(enum.Enum):
    """How it is."""

    GOOD = "ok"
    LACKING = "-"  # A part that not everybody needs, or something slower than it could be.
    BAD = "BAD"  # mirte_drake does not work like this.


@dc.dataclass(frozen=True)
class Finding:
    """One line of the report."""

    what: str
    grade: Grade
    says: str
    remedy: str = ""  # Empty where nothing is to be done.


def text(finding: Finding) -> str:
    """Returns a finding as a line, its remedy below it."""
    line = f"{finding.grade.value:>3}  {finding.what:15} {finding.says}"
    return f"{line}\n{'':21}{finding.remedy}" if finding.remedy else line
