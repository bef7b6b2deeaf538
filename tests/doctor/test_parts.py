import numba
import pydrake.solvers
import pytest

from mirte_drake.doctor import parts
from mirte_drake.doctor.finding import Grade
from mirte_drake.doctor.parts import WIRES, check_compiled, check_solvers, check_wires
from mirte_drake.errors import UserError
from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.messages import Odometry


class FakeLink(Link):
    """A wire within the test, that may be cut."""

    exposed_to = ""
    ends: dict = {}  # noqa: RUF012 One wire.
    cut = False

    def __init__(self, config, role):
        super().__init__(role)
        self.exposure = self.exposed_to
        self.ends[role] = self

    def wait(self, timeout):
        return bool(self._inboxes[Odometry])

    def send(self, message):
        if not self.cut:
            self.ends[Role.CONTROLLER]._deliver(message)

    def close(self):
        pass


@pytest.fixture
def fake_wire(monkeypatch):
    monkeypatch.setattr(parts, "open_link", FakeLink)
    return monkeypatch


def test_solvers_of_drake_are_there():
    assert [(f.what, f.grade) for f in check_solvers()] == [
        ("SNOPT", Grade.GOOD), ("IPOPT", Grade.GOOD)
    ]  # fmt: skip


def test_a_drake_without_a_solver_is_lacking(monkeypatch):
    monkeypatch.setattr(pydrake.solvers.SnoptSolver, "available", lambda self: False)
    snopt, ipopt = check_solvers()
    assert (snopt.grade, ipopt.grade) == (Grade.LACKING, Grade.GOOD)
    assert "nominal_nmpc.solver=snopt" in snopt.says and "pip install" in snopt.remedy


def test_where_compiled_code_is_kept():
    finding = check_compiled()
    assert finding.grade is Grade.GOOD and str(parts.all_finite.stats.cache_path) in finding.says


def test_without_a_folder_for_it_compiled_code_is_lacking(monkeypatch):
    monkeypatch.setattr(parts, "all_finite", numba.njit(lambda array: True))
    finding = check_compiled()
    assert finding.grade is Grade.LACKING and "NUMBA_CACHE_DIR" in finding.remedy


def test_a_sound_wire_has_its_latency(fake_wire):
    fake_wire.setattr(FakeLink, "_deliver", lambda self, message: Link._deliver(
        self, Odometry(message.stamp, message.pose, message.body_velocity, 1e9)))  # fmt: skip
    findings = list(check_wires())
    assert [finding.what for finding in findings] == list(WIRES)
    assert all(finding.grade is Grade.GOOD for finding in findings)
    assert "ms on this machine" in findings[0].says


def test_a_wire_that_others_can_speak_on_is_told(fake_wire):
    fake_wire.setattr(FakeLink, "exposed_to", "whoever is on the network can speak")
    finding = next(iter(check_wires()))
    assert (finding.grade, finding.remedy) == (Grade.LACKING, FakeLink.exposed_to)


def test_a_wire_that_carries_nothing_is_lacking(fake_wire):
    fake_wire.setattr(FakeLink, "cut", True)
    for finding in check_wires(patience=0.05):
        assert finding.grade is Grade.LACKING
        assert "no message comes through" in finding.says and "ip route add" in finding.remedy


def test_a_middleware_that_is_missing_is_lacking(monkeypatch):
    def missing(config, role):
        raise UserError("needs the package cyclonedds: pip install mirte-drake[ros2]")

    monkeypatch.setattr(parts, "open_link", missing)
    for finding in check_wires():
        assert finding.grade is Grade.LACKING
        assert "pip install mirte-drake[ros2]" in finding.remedy


def test_no_drive_hears_the_check():
    lcm, ros2 = WIRES.values()
    assert lcm.prefix != type(lcm)().prefix
    assert ros2.domain != type(ros2)().domain
    for config in WIRES.values():
        config.validate()


@pytest.mark.slow
def test_the_wires_of_this_machine():
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
    for finding in check_wires():
        assert "ms on this machine" in finding.says or finding.remedy
