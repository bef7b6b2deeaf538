"""Names and order of vector entries, in one place."""

from pydrake.common.containers import namedview

POSE = ("x", "y", "theta")
BODY_VELOCITY = ("vx", "vy", "yaw_rate")
# u1..u4 of the thesis. The recordings' columns have another order: use the names.
WHEELS = ("front_left", "front_right", "rear_right", "rear_left")

Pose = namedview("Pose", POSE)
BodyVelocity = namedview("BodyVelocity", BODY_VELOCITY)
WheelCommand = namedview("WheelCommand", WHEELS)
