"""What a Diagram has only where somebody watches it."""

import dataclasses as dc

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort

from mirte_drake.robots.multibody_robot import MultibodyRobotConfig
from mirte_drake.robots.robot_description import robot_sdf
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.robots.rolling_odometry import AddRollingWheels
from mirte_drake.scenario import Scenario, WiredRobotConfig
from mirte_drake.systems.held_tube import AddHeldTube
from mirte_drake.systems.horizon_tube import AddHorizonTube
from mirte_drake.systems.velocity_setpoint import VelocitySetpointConfig
from mirte_drake.visualization.live_disturbance import AddLiveDisturbance
from mirte_drake.visualization.meshcat_scene import AddMeshcatScene
from mirte_drake.visualization.scene.shapes import read_robot_shapes
from mirte_drake.visualization.scene.stage import Patch, Stage

ROOM = 1.0  # [m] Around the start of a robot whose path nobody knows.


def floor_patches(scenario: Scenario) -> list[Patch]:
    """Returns the patches of another friction on the floor of a scenario."""
    robot = scenario.robot
    if not isinstance(robot, MultibodyRobotConfig):
        return []
    return [Patch(patch.center, patch.size) for patch in robot.patches]


def scene_stage(scenario: Scenario, background: str = "light") -> Stage:
    """Returns where the robot of a scenario will be, and what is on the floor there."""
    robot = scenario.robot
    start = None if isinstance(robot, WiredRobotConfig) else robot.initial_pose
    start = (scenario.first_pose if start is None else start)[:2]
    if isinstance(scenario.reference, VelocitySetpointConfig):
        places = start + ROOM * np.array([[-1.0, -1.0], [1.0, 1.0]])
        return Stage(np.zeros((0, 2)), places, floor_patches(scenario), background)
    path = scenario.reference.poses(scenario.period)[:, :2]
    return Stage(path, start[None], floor_patches(scenario), background)


@dc.dataclass(frozen=True)
class LiveView:
    """Shows the Diagram of a scenario in Meshcat; a View of ``MakeDiagram``."""

    scenario: Scenario
    meshcat: Meshcat
    background: str = "light"  # Or "dark".

    def add_disturbance_controls(
        self, builder: DiagramBuilder, disturbance: OutputPort
    ) -> OutputPort:
        """Adds a LiveDisturbance behind the disturbance, and returns its output."""
        live = AddLiveDisturbance(builder, self.meshcat, period=self.scenario.period)
        builder.Connect(disturbance, live.GetInputPort("disturbance"))
        return live.GetOutputPort("live_disturbance")

    def add_scene(
        self,
        builder: DiagramBuilder,
        controller: Diagram,
        reference: LeafSystem,
        robot: RobotPorts,
        disturbance: OutputPort | None,
    ) -> None:
        """Adds a MeshcatScene, and the tube ahead and rolling wheels where it needs them."""
        period, horizon = self.scenario.period, self.scenario.nominal_nmpc.horizon
        stage, shapes = scene_stage(self.scenario, self.background), read_robot_shapes(robot_sdf())
        scene = AddMeshcatScene(
            builder, self.meshcat, stage, shapes, period=period, horizon=horizon
        )
        assert robot.true_pose is not None
        shown = {
            "pose": robot.pose,
            "true_pose": robot.true_pose,
            "reference": reference.GetOutputPort("reference"),
            "wheel_command": controller.GetOutputPort("wheel_command"),
            "wheel_angles": robot.wheel_angles or AddRollingWheels(builder, robot.body_velocity),
        }
        if disturbance is not None:
            shown["disturbance"] = disturbance
        if controller.HasOutputPort("plan"):
            shown["plan"] = controller.GetOutputPort("plan")
        if self.scenario.has_tube:
            shown["half_widths"] = self._add_tube(builder, controller)
        for name, port in shown.items():
            builder.Connect(port, scene.GetInputPort(name))

    def _add_tube(self, builder: DiagramBuilder, controller: Diagram) -> OutputPort:
        """Adds the tube ahead, predicted where that is known how."""
        config, horizon = self.scenario.tube_updater, self.scenario.nominal_nmpc.horizon
        tube: LeafSystem
        if config is not None:
            tube = AddHorizonTube(builder, config, period=self.scenario.period, horizon=horizon)
        else:
            states = controller.GetOutputPort("half_width").size()
            tube = AddHeldTube(builder, horizon=horizon, states=states)
        for port in ("plan", "designs" if config is not None else "half_width"):
            builder.Connect(controller.GetOutputPort(port), tube.GetInputPort(port))
        return tube.GetOutputPort("half_widths")
