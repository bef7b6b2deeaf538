"""What the thesis says of its figures, in numbers."""

# RMSE of pose [m, m, rad] and body velocity [m/s, m/s, rad/s], tables 3-4 and 3-5.
VALIDATION_RMSE = {
    "3-3": {
        "kinematic": (0.45, 0.78, 0.43, 0.12, 0.01, 0.17),
        "extended_kinematic": (0.31, 0.36, 0.05, 0.12, 0.02, 0.17),
        "dynamic": (0.45, 0.51, 0.51, 0.10, 0.04, 0.22),
    },
    "3-4": {
        "kinematic": (0.58, 0.31, 0.55, 0.11, 0.05, 0.10),
        "extended_kinematic": (0.52, 0.18, 0.28, 0.11, 0.05, 0.07),
        "dynamic": (0.22, 0.18, 0.30, 0.11, 0.07, 0.06),
    },
}
# Of the whole run [s], section 5-2: fmincon in chapter 4, acados in chapter 5.
RUN_TIME = {"4-2": 42.8, "4-3": 46.4, "5-2": 2.1, "5-3": 2.6}
YAW_ERROR = {"4-2": 0.02, "4-3": 0.01}  # [rad] "remains bounded within approximately".
# What the text says beside numbers.
CLAIM = {
    "5-2": "the nominal trajectory closely tracks the reference and the state remains within the "
    "tube; RMSE in x and y is roughly 1 cm lower than in MATLAB, yaw about the same.",
    "5-3": "the y position improves by about 2.5 cm on MATLAB, the rest is similar.",
    "5-4": "tighter tracking by the tube-based controller, larger deviations at the corners and "
    "more yaw drift without it.",
    "5-5": "satisfactory by both controllers: slightly lower errors forward and in yaw with the "
    "tube, a lower lateral error without.",
}
