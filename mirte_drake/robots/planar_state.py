"""What the planar world sees of the multibody robot: pose, velocity, wheel angles."""

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RpyFloatingJoint
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from mirte_drake.angles import rotation
from mirte_drake.vectors import WHEELS, YAW


class PlanarState(LeafSystem):
    """Picks the planar motion out of the plant's state.

    .. pydrake_system::

        name: PlanarState
        input_ports:
        - plant_state
        output_ports:
        - true_pose
        - true_body_velocity
        - wheel_angles

    ==================  ===========  ==================  ========================================
    port                type         unit                meaning
    ==================  ===========  ==================  ========================================
    plant_state (in)    vector (n,)  plant's             positions and velocities of the robot
    true_pose           vector (3,)  [m, m, rad]         of the base, world frame, yaw unwrapped
    true_body_velocity  vector (3,)  [m/s, m/s, rad/s]   of the base, in its own frame
    wheel_angles        vector (4,)  [rad]               against the base: what encoders see
    ==================  ===========  ==================  ========================================

    The yaw is a coordinate of the floating joint, integrated by the plant, so nothing wraps.
    """

    def __init__(
        self, plant: MultibodyPlant, robot: ModelInstanceIndex, floating: RpyFloatingJoint
    ) -> None:
        """Declares ports.

        Args:
            plant: Finalized plant.
            robot: The robot in it.
            floating: The joint between the world and the base.
        """
        super().__init__()
        # The robot is the only thing in the plant that moves: its entries are the plant's.
        self._input = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states(robot))
        roll, n = floating.position_start(), plant.num_positions(robot)
        self._pose = [roll + 3, roll + 4, roll + 2]  # Of roll, pitch, yaw, x, y, z.
        rate = n + floating.velocity_start()
        self._velocity = [rate + 3, rate + 4, rate + 2]  # Of the same, in the world frame.
        self._wheels = [plant.GetJointByName(wheel, robot).position_start() for wheel in WHEELS]
        state = {self._input.ticket()}
        self.DeclareVectorOutputPort("true_pose", 3, self._calc_pose, state)
        self.DeclareVectorOutputPort("true_body_velocity", 3, self._calc_velocity, state)
        self.DeclareVectorOutputPort("wheel_angles", len(WHEELS), self._calc_wheels, state)

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._input.Eval(context)[self._pose])

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        state = self._input.Eval(context)
        yaw = state[self._pose[YAW]]
        output.SetFromVector(rotation(yaw).T @ state[self._velocity])

    def _calc_wheels(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._input.Eval(context)[self._wheels])
