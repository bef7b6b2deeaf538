"""A model's equations, the way a person writes them: as text and as LaTeX."""

import dataclasses as dc
import textwrap
from collections.abc import Callable, Mapping

from mirte_drake.geometry import FORWARD_KINEMATICS
from mirte_drake.model.candidate_library import COS, SIN
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.model.model_file import ModelFile
from mirte_drake.vectors import POSE_SIZE

DIGITS = 5
_GLUE = "\N{NO-BREAK SPACE}"  # Holds a term together while lines are wrapped.


@dc.dataclass(frozen=True)
class _Notation:
    number: Callable[[float], str]
    name: Callable[[str], str]
    product: str  # Between the factors of a term.


def equations_text(model: ModelFile, width: int = 100) -> str:
    """Returns the equations, terms with the same factor of yaw in brackets, wrapped at width."""
    if model.lagged is not None:
        return _lagged_text(model.lagged)
    lines = []
    for state, table in model.derivatives.items():
        left = f"d{state}/dt = "
        indent = " " * len(left)
        for number, group in enumerate(_groups(table, _TEXT)):
            first = left + group.removeprefix(f"+{_GLUE}") if number == 0 else indent + group
            lines += textwrap.wrap(
                first, width, subsequent_indent=indent + "  ", break_on_hyphens=False
            )
    return "\n".join(lines).replace(_GLUE, " ").replace("= - ", "= -").replace("(- ", "(-")


def _lagged_text(lagged: LaggedParameters) -> str:
    """Returns the equations of a LaggedModel; s are wheel speeds."""
    kinematics = lagged.axis_gain[:, None] * FORWARD_KINEMATICS
    lines = ["d(x, y)/dt = R(theta) (vx, vy)", "dtheta/dt = yaw_rate"]
    for state, lag, row in zip(LaggedModel.states[POSE_SIZE:], lagged.lag, kinematics, strict=True):
        terms = {f"s{wheel}": gain for wheel, gain in enumerate(row, start=1)}
        (steady,) = _groups(terms, _TEXT)
        steady = steady.replace(_GLUE, " ").removeprefix("+ ")
        line = f"d{state}/dt = ({steady} - {state}) / {lag:.{DIGITS}g}"
        lines.append(line.replace("(- ", "(-"))
    driven = f"max(|u| - {lagged.deadband:.{DIGITS}g}, 0)"
    for wheel, (forward, backward) in enumerate(lagged.wheel_gain.T, start=1):
        gains = f"{forward:.{DIGITS}g} forward, {backward:.{DIGITS}g} backward"
        lines.append(f"s{wheel} = sign(u{wheel}) {driven} times {gains}")
    lines.append(f"u is that of {lagged.delay} samples ago")
    return "\n".join(lines)


def equations_latex(model: ModelFile) -> str:
    r"""Returns the equations that were identified as a LaTeX ``aligned`` environment."""
    lines = []
    for state, table in model.derivatives.items():
        if state.removesuffix("_dot") == state and f"{state}_dot" in model.states:
            continue  # A pose whose derivative is a state: nothing to say.
        first, *rest = _groups(table, _LATEX)
        first = first.removeprefix("+" + _GLUE)
        lines.append(rf"{_derivative(state)} ={{}} & {first}")
        lines += [f"& {group}" for group in rest]
    body = " \\\\\n".join(lines).replace(f"& -{_GLUE}", "& {-}").replace(f"(-{_GLUE}", "({-}")
    return "\\begin{aligned}\n" + body.replace(_GLUE, " ") + "\n\\end{aligned}"


def _groups(table: Mapping[str, float], notation: _Notation) -> list[str]:
    """Returns the terms without yaw, those with its sine, those with its cosine."""
    groups: dict[str, dict[str, float]] = {"": {}, SIN: {}, COS: {}}
    for term, coefficient in table.items():
        factors = term.split("*")
        factor = next((f for f in (SIN, COS) if f in factors), "")
        if factor:
            factors.remove(factor)
        groups[factor]["*".join(factors) or "1"] = coefficient
    result = []
    for factor, terms in groups.items():
        words = [_word(term, coefficient, notation) for term, coefficient in terms.items()]
        if not words:
            continue
        total = " ".join(words)
        if factor:
            inner = total.removeprefix(f"+{_GLUE}")
            total = f"+{_GLUE}{notation.name(factor)}{notation.product}({inner})"
        result.append(total)
    return result


def _word(term: str, coefficient: float, notation: _Notation) -> str:
    """Returns a term with its sign, held together."""
    factors = [notation.name(factor) for factor in term.split("*") if factor != "1"]
    if abs(coefficient) != 1.0 or not factors:
        factors.insert(0, notation.number(abs(coefficient)))
    sign = "-" if coefficient < 0 else "+"
    return f"{sign}{_GLUE}{notation.product.join(factors)}"


def _latex_number(value: float) -> str:
    mantissa, _, exponent = f"{value:.{DIGITS}g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa


def _latex_name(name: str) -> str:
    known = {SIN: r"\sin\theta", COS: r"\cos\theta", "theta": r"\theta", "yaw_rate": r"\Omega"}
    if name in known:
        return known[name]
    if name.endswith("_dot"):
        return rf"\dot{{{_latex_name(name.removesuffix('_dot'))}}}"
    return f"{name[0]}_{{{name[1:]}}}" if len(name) > 1 else name


def _derivative(state: str) -> str:
    dots = r"\ddot" if state.endswith("_dot") else r"\dot"
    return rf"{dots}{{{_latex_name(state.removesuffix('_dot'))}}}"


_TEXT = _Notation(lambda value: f"{value:.{DIGITS}g}", str, _GLUE)
_LATEX = _Notation(_latex_number, _latex_name, r"\,")
