"""Draws a Diagram in Meshcat while it runs."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem

from mirte_drake.vectors import POSE, POSE_SIZE, WHEELS
from mirte_drake.visualization.scene.drawer import SceneDrawer
from mirte_drake.visualization.scene.frame import Frame, Trail
from mirte_drake.visualization.scene.shapes import RobotShapes
from mirte_drake.visualization.scene.stage import Stage

FRAMES_PER_SAMPLE = 3  # 30 per second at 10 Hz: the robot glides.
LONGEST_TRAIL = 300  # Samples: more would make a browser slow.


class MeshcatScene(LeafSystem):
    """Draws robot, plan, tube and trails.

    .. pydrake_system::

        name: MeshcatScene
        input_ports:
        - pose
        - true_pose
        - reference
        - plan
        - wheel_command
        - wheel_angles
        - half_widths
        - disturbance

    ==================  =================  ==================  ==================================
    port                type               unit                meaning
    ==================  =================  ==================  ==================================
    pose (in)           vector (3,)        [m, m, rad]         measured, world frame
    true_pose (in)      vector (3,)        [m, m, rad]         world frame
    reference (in)      vector (3,)        [m, m, rad]         r_k
    plan (in)           Plan               -                   of sample k; open: none
    wheel_command (in)  vector (4,)        [pwm]               u
    wheel_angles (in)   vector (4,)        [rad]               turned since the start
    half_widths (in)    vector (3 (N+1),)  [m, m, rad]         d_k, ..., d_{k+N}; open: no tube
    disturbance (in)    vector (3,)        [m/s, m/s, rad/s]   body frame; open: zero
    ==================  =================  ==================  ==================================

    Draws ``FRAMES_PER_SAMPLE`` times in each sample; between samples plan and tube move on along
    themselves. State: measured and true pose (6,) of the last sample, where the trails go on.
    Initialisation removes the trails. What is seen is in Meshcat, which all Contexts share.
    """

    def __init__(self, drawer: SceneDrawer, *, period: float, horizon: int) -> None:
        """Declares ports, state and events.

        Args:
            drawer: Draws.
            period: [s] sample time T_s.
            horizon: N.
        """
        super().__init__()
        self._drawer, self._period, self._horizon = drawer, period, horizon
        self._pose = self.DeclareVectorInputPort("pose", POSE_SIZE)
        self._true_pose = self.DeclareVectorInputPort("true_pose", POSE_SIZE)
        self._reference = self.DeclareVectorInputPort("reference", POSE_SIZE)
        self._plan = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._wheel_command = self.DeclareVectorInputPort("wheel_command", len(WHEELS))
        self._wheel_angles = self.DeclareVectorInputPort("wheel_angles", len(WHEELS))
        self._half_widths = self.DeclareVectorInputPort("half_widths", 3 * (horizon + 1))
        self._disturbance = self.DeclareVectorInputPort("disturbance", POSE_SIZE)
        self.DeclareDiscreteState(2 * POSE_SIZE)
        self.DeclareInitializationPublishEvent(lambda context: drawer.forget())
        self.DeclarePeriodicPublishEvent(period / FRAMES_PER_SAMPLE, 0.0, self._draw)
        # Published before the update of the same instant: from the last sample to this one.
        self.DeclarePeriodicPublishEvent(period, 0.0, self._leave)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def frame(self, context: Context) -> Frame:
        """Returns what is seen at the instant of a Context."""
        pose = self._pose.Eval(context)
        plan = self._plan.Eval(context) if self._plan.HasValue(context) else None
        states, share = np.tile(pose, (self._horizon + 1, 1)), 0.0
        widths = np.zeros(3 * (self._horizon + 1))
        # Before the first solve the plan is not yet where the robot is.
        if plan is not None and plan.sample >= 0:
            states = plan.states[:, POSE]
            share = np.clip(context.get_time() / self._period - plan.sample, 0.0, 1.0)
            if self._half_widths.HasValue(context):
                widths = self._half_widths.Eval(context)
        disturbed = self._disturbance.HasValue(context)
        return Frame(
            pose=pose,
            true_pose=self._true_pose.Eval(context),
            reference=self._reference.Eval(context),
            plan=_moved_on(states, share),
            half_widths=_moved_on(widths.reshape(-1, POSE_SIZE), share),
            disturbance=self._disturbance.Eval(context) if disturbed else np.zeros(POSE_SIZE),
            wheel_command=self._wheel_command.Eval(context),
            wheel_angles=self._wheel_angles.Eval(context),
        )

    def _draw(self, context: Context) -> None:
        self._drawer.draw(self.frame(context))

    def _leave(self, context: Context) -> None:
        sample = round(context.get_time() / self._period)
        if sample == 0:
            return
        last = context.get_discrete_state_vector().value().reshape(2, POSE_SIZE)
        now = self._poses(context)
        nominal, widths = np.stack([last[0], now[0]]), np.zeros((2, POSE_SIZE))
        if self._plan.HasValue(context):
            nominal = self._plan.Eval(context).states[:2, POSE]
        if self._half_widths.HasValue(context):
            widths = self._half_widths.Eval(context).reshape(-1, POSE_SIZE)[:2]
        trail = Trail(
            np.stack([last[0], now[0]]),
            np.stack([last[1], now[1]]),
            nominal[None],
            widths[None],
        )
        self._drawer.leave(trail, sample % LONGEST_TRAIL)

    def _poses(self, context: Context) -> np.ndarray:
        return np.stack([self._pose.Eval(context), self._true_pose.Eval(context)])

    def _remember(self, context: Context, next_state: DiscreteValues) -> None:
        next_state.set_value(self._poses(context).ravel())


def _moved_on(stages: np.ndarray, share: float) -> np.ndarray:
    """Returns stages (N + 1, n), each moved towards the next by a share of the way."""
    return np.vstack([stages[:-1] + share * np.diff(stages, axis=0), stages[-1:]])


def AddMeshcatScene(
    builder: DiagramBuilder,
    meshcat: Meshcat,
    stage: Stage,
    robot: RobotShapes,
    *,
    period: float,
    horizon: int,
    name: str = "meshcat_scene",
) -> MeshcatScene:
    """Draws what stands still, and adds a MeshcatScene to ``builder``.

    Args:
        builder: The builder; the caller connects the system's ports.
        meshcat: Where to draw.
        stage: Where the robot will be.
        robot: What it looks like.
        period: [s] sample time T_s.
        horizon: N.
        name: Name of the system.
    """
    drawer = SceneDrawer(meshcat, stage, robot, horizon)
    return builder.AddNamedSystem(name, MeshcatScene(drawer, period=period, horizon=horizon))
