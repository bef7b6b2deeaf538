import numpy as np
import pytest
from scripted_link import ScriptedLink

from mirte_drake.faults.deaf_link import DeafLink
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import DriveCommand, Odometry, WheelCommand

COMMAND = DriveCommand(5, 0, np.zeros(4), np.zeros(3), 0, False)
ODOMETRY = Odometry(0, np.zeros(3), np.zeros(3))


class Orders:
    deaf = False


@pytest.mark.parametrize(("deaf", "heard"), [(False, 1), (True, 0)])
def test_a_deaf_guard_hears_the_robot_alone(deaf, heard):
    wire, orders = ScriptedLink(Role.GUARD), Orders()
    link = DeafLink(wire, orders)
    orders.deaf = deaf
    wire.at(100.01, COMMAND)
    wire.at(100.01, ODOMETRY)
    assert link.wait(0.1)
    assert len(link.take(DriveCommand)) == heard
    assert len(link.take(Odometry)) == 1
    link.send(WheelCommand(np.ones(4)))
    assert len(wire.sent) == 1
