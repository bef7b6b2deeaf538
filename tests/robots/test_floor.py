import numpy as np
import pytest
from pydrake.multibody.plant import CalcContactFrictionFromSurfaceProperties, CoulombFriction

from mirte_drake.robots.floor import FrictionPatch, gravity_on_slope, surface_friction
from mirte_drake.robots.mecanum_wheel import ROLLER_FRICTION


@pytest.mark.parametrize("friction", [0.05, 0.8, 1.0])
def test_surface_makes_the_wanted_friction_with_the_rollers(friction):
    floor, roller = (
        CoulombFriction(mu, mu) for mu in (surface_friction(friction), ROLLER_FRICTION)
    )
    combined = CalcContactFrictionFromSurfaceProperties(floor, roller)
    assert combined.static_friction() == pytest.approx(friction)
    assert combined.dynamic_friction() == pytest.approx(friction)


def test_level_floor_has_gravity_along_its_normal():
    np.testing.assert_array_equal(gravity_on_slope(np.zeros(2)), [0, 0, -9.81])


@pytest.mark.parametrize(
    ("slope", "expected"),
    [
        ([np.pi / 6, 0], [-9.81 / 2, 0, -9.81 * np.sqrt(3) / 2]),  # Uphill is forward.
        ([0, -np.pi / 6], [0, 9.81 / 2, -9.81 * np.sqrt(3) / 2]),
        ([0.3, 0.4], [-9.81 * 0.6 * np.sin(0.5), -9.81 * 0.8 * np.sin(0.5), -9.81 * np.cos(0.5)]),
    ],
)
def test_gravity_on_a_slope_pulls_downhill(slope, expected):
    np.testing.assert_allclose(gravity_on_slope(np.array(slope)), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("center", np.zeros(3)),
        ("size", np.array([1.0, 0.0])),
        ("size", np.array([1.0, np.nan])),
        ("friction", 0.0),
        ("friction", 1.1),
        ("friction", np.nan),
    ],
)
def test_rejects_bad_patch(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        FrictionPatch(**{field: value}).validate()
