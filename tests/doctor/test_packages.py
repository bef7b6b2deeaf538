import importlib.metadata
import sys
from email.message import Message

import pytest
from packaging.requirements import Requirement

from mirte_drake.doctor.finding import Finding, Grade, text
from mirte_drake.doctor.packages import check_package, check_packages, check_python


@pytest.fixture
def metadata(monkeypatch):
    """Metadata of an installation that the test may fill in."""
    message = Message()
    message["Requires-Python"] = ">=3.11"
    real = importlib.metadata.metadata
    monkeypatch.setattr(
        importlib.metadata,
        "metadata",
        lambda name: message if name == "mirte-drake" else real(name),
    )
    return message


def test_a_finding_is_a_line_with_its_remedy_below():
    finding = Finding("timer", Grade.LACKING, "late", "hurry")
    assert text(finding) == "  -  timer           late\n                     hurry"
    assert text(Finding("drake", Grade.GOOD, "1.51")) == " ok  drake           1.51"


@pytest.mark.parametrize(
    ("version", "grade"), [("3.11.2", "GOOD"), ("3.14.0rc1", "GOOD"), ("3.10.9", "BAD")]
)
def test_python_must_be_new_enough(version, grade):
    finding = check_python(">=3.11", version)
    assert finding.grade is Grade[grade] and version in finding.says
    assert bool(finding.remedy) == (grade == "BAD")


def test_what_is_there_is_good():
    finding = check_package(Requirement("PyYAML>=6"))
    assert finding == Finding("PyYAML", Grade.GOOD, importlib.metadata.version("pyyaml"))


@pytest.mark.parametrize(
    ("requirement", "extra", "grade", "says", "remedy"),
    [
        ("nowhere>=1", "", "BAD", "is not installed", "pip install 'nowhere>=1'"),
        ("nowhere>=1", "ros2", "LACKING", "is not installed, for [ros2]",
         "pip install 'mirte-drake[ros2]'"),
        ("numpy>=99", "", "BAD", "but >=99 is needed", "pip install 'numpy>=99'"),
        ("numpy>=99", "bags", "LACKING", "but >=99 is needed, for [bags]",
         "pip install 'mirte-drake[bags]'"),
    ],
)  # fmt: skip
def test_what_is_missing_or_old_has_a_remedy(requirement, extra, grade, says, remedy):
    finding = check_package(Requirement(requirement), extra)
    assert finding.grade is Grade[grade]
    assert says in finding.says and finding.remedy == remedy


@pytest.mark.parametrize("error", [ImportError("libX11.so.6: not found"), OSError("broken")])
def test_what_cannot_be_loaded_is_bad(error, monkeypatch):
    class Broken:
        def find_spec(self, name, *_):
            if name == "pygraphviz":
                raise error

    monkeypatch.delitem(sys.modules, "pygraphviz", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    finding = check_package(Requirement("pygraphviz>=2"))
    assert finding.grade is Grade.BAD
    assert str(error) in finding.says and "apt install" in finding.remedy


def test_required_and_optional_packages_come_from_the_metadata(metadata):
    for name in ("ros2", "dev", "bags"):
        metadata["Provides-Extra"] = name
    for line in (
        "numpy>=1.26",
        "nothing-needed; python_version < '3'",
        "cyclone-nowhere>=11; extra == 'ros2'",
        "mirte-drake[bags]; extra == 'ros2'",
        "pytest>=8; extra == 'dev'",
        "bags-nowhere; extra == 'bags'",
    ):
        metadata["Requires-Dist"] = line
    found = [(finding.what, finding.grade) for finding in check_packages()]
    assert found == [
        ("Python", Grade.GOOD),
        ("numpy", Grade.GOOD),
        ("bags-nowhere", Grade.LACKING),
        ("cyclone-nowhere", Grade.LACKING),
    ]


def test_a_source_without_installation_is_told(monkeypatch):
    def nowhere(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "metadata", nowhere)
    (finding,) = check_packages()
    assert finding.grade is Grade.LACKING and "pip install ." in finding.remedy
