"""What identification and validation found, as text for a person."""

from collections.abc import Mapping

from mirte_drake.identification.sparse_regression import ThresholdRow
from mirte_drake.identification.validation import Validation


def threshold_text(best: Mapping[str, float], tables: Mapping[str, list[ThresholdRow]]) -> str:
    """Returns the error tables of a threshold search; a star marks what was chosen.

    Args:
        best: Chosen threshold by state.
        tables: Rows by state.
    """
    lines = [f"{'state':10}{'threshold':>12}{'terms':>7}{'training error':>17}{'held out':>11}"]
    for state, rows in tables.items():
        for row in rows:
            star = " *" if row.threshold == best[state] else ""
            lines.append(
                f"{state:10}{row.threshold:12.2e}{row.terms:7d}{row.training_error:17.5f}"
                f"{row.held_out_error:11.5f}{star}"
            )
    return "\n".join(lines)


def validation_text(results: Mapping[str, Validation]) -> str:
    """Returns a table like 3-4 and 3-5: RMSE of pose and body velocity, a line per model."""
    head = ("x [m]", "y [m]", "yaw [rad]", "vx [m/s]", "vy [m/s]", "yaw rate [rad/s]")
    lines = [
        f"{'RMSE, open loop':24}" + "".join(f"{name:>11}" for name in head[:5]) + f"{head[5]:>18}"
    ]
    for name, result in results.items():
        pose = "".join(f"{value:11.3f}" for value in result.pose_rmse)
        velocity = "".join(f"{value:11.3f}" for value in result.velocity_rmse[:2])
        lines.append(f"{name:24}{pose}{velocity}{result.velocity_rmse[2]:18.3f}")
    return "\n".join(lines)
