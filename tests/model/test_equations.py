import re

import pytest

from mirte_drake.model.equations import equations_latex, equations_text
from mirte_drake.model.model_file import ModelFile, load_model_file, model_names


def model(**derivatives) -> ModelFile:
    return ModelFile(name="m", states={"x": "m", "y": "m", "theta": "rad"}, derivatives=derivatives)


def test_terms_are_grouped_by_their_factor_of_yaw():
    table = {"u1": 0.5, "sin(theta)*u1": -2.0, "cos(theta)*u2": 1.0, "cos(theta)*u1*u2": 1e-7}
    assert equations_text(model(x=table)).splitlines() == [
        "dx/dt = 0.5 u1",
        "        + sin(theta) (-2 u1)",
        "        + cos(theta) (u2 + 1e-07 u1 u2)",
    ]


def test_lines_keep_the_width_and_break_between_terms():
    text = equations_text(load_model_file("extended_kinematic"), width=60)
    assert max(map(len, text.splitlines())) <= 60
    for line in text.splitlines():
        assert not line.rstrip().endswith(("+", "-"))


@pytest.mark.parametrize("name", model_names())
def test_every_coefficient_stands_in_the_text(name):
    content = load_model_file(name)
    text = " ".join(equations_text(content).split())
    for table in content.derivatives.values():
        for coefficient in table.values():
            if abs(coefficient) != 1.0:
                assert f"{abs(coefficient):.5g} " in text


def test_a_constant_and_a_leading_minus():
    assert equations_text(model(x={"1": -3.0, "u1": 1.0})) == "dx/dt = -3 + u1"


def test_latex_writes_derivatives_powers_and_names():
    latex = equations_latex(load_model_file("dynamic"))
    assert r"\ddot{x} ={} & \sin\theta\,(1.037\,v_{y}" in latex
    assert r"\ddot{\theta} ={} & {-}1.2711\,\Omega" in latex
    assert latex.count("={}") == 3  # Nothing of x_dot = x_dot.
    latex = equations_latex(load_model_file("extended_kinematic"))
    assert r"7.1607 \cdot 10^{-5}\,u_{1}\,u_{1}" in latex
    assert latex.count("{") == latex.count("}")
    assert re.match(r"\\begin\{aligned\}\n.*\n\\end\{aligned\}$", latex, re.S)
