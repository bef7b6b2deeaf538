"""The shapes that a robot's SDF shows, part by part, drawn in Meshcat."""

import dataclasses as dc

from pydrake.geometry import Meshcat, Rgba, Role, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from mirte_drake.vectors import WHEELS


@dc.dataclass(frozen=True)
class RobotShape:
    """One shape of a part that moves as a whole."""

    part: str  # One of ``vectors.WHEELS``, its rollers included, or "body".
    name: str  # Unique in the part.
    X: RigidTransform  # In the frame of the part, that of the model where it is the body.
    shape: Shape
    color: Rgba


@dc.dataclass(frozen=True)
class RobotShapes:
    """What a robot looks like."""

    shapes: tuple[RobotShape, ...]
    wheels: dict[str, RigidTransform]  # Frames of the wheels that have not turned, in the model's.


def read_robot_shapes(sdf: str) -> RobotShapes:
    """Returns the shapes to look at of a robot.

    A roller belongs to its wheel as if it did not turn: it is a body of revolution of one colour,
    so that nobody sees it turn about its own axis.

    Args:
        sdf: The robot, whose links of a wheel begin with the wheel's name and of which
            NAME_wheel is the one that turns about y.
    """
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    (robot,) = Parser(plant).AddModelsFromString(sdf, "sdf")
    plant.Finalize()
    context, inspector = plant.CreateDefaultContext(), scene_graph.model_inspector()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(robot)]
    poses = {body.name(): body.EvalPoseInWorld(context) for body in bodies}
    wheels = {wheel: poses[f"{wheel}_wheel"] for wheel in WHEELS}
    shapes = []
    for body in bodies:
        part = next((wheel for wheel in WHEELS if body.name().startswith(wheel)), "body")
        X_part = wheels.get(part, RigidTransform())
        frame = plant.GetBodyFrameIdOrThrow(body.index())
        for geometry in inspector.GetGeometries(frame, Role.kIllustration):
            shapes.append(
                RobotShape(
                    part,
                    f"{body.name()}/{inspector.GetName(geometry).split('::')[-1]}",
                    X_part.inverse() @ poses[body.name()] @ inspector.GetPoseInFrame(geometry),
                    inspector.GetShape(geometry),
                    inspector.GetIllustrationProperties(geometry).GetProperty("phong", "diffuse"),
                )
            )
    return RobotShapes(tuple(shapes), wheels)


def draw_robot_shapes(meshcat: Meshcat, path: str, robot: RobotShapes) -> None:
    """Draws a robot at ``path``: its body at PATH/body, each wheel at PATH/WHEEL."""
    for shape in robot.shapes:
        place = f"{path}/{shape.part}/{shape.name}"
        meshcat.SetObject(place, shape.shape, shape.color)
        meshcat.SetTransform(place, shape.X)
