"""Order of vector entries, in one place.

Poses are x, y, yaw [m, m, rad] in the world frame; body velocities vx, vy, yaw rate [m/s, m/s,
rad/s]; wheel commands front left, front right, rear right, rear left [PWM percent], which are
u1..u4 of the thesis. The recordings' columns have another wheel order: go by their names.
"""

POSE = slice(0, 3)  # Entries of a model state that are the pose.
POSE_SIZE = 3
YAW = 2
WHEELS = ("front_left", "front_right", "rear_right", "rear_left")
