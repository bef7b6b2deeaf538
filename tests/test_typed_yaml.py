import dataclasses as dc
import signal

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.files import read_text, replacing
from mirte_drake.typed_yaml import load_typed, parse_typed, write_typed


@dc.dataclass
class Wheel:
    radius: float = 0.05
    gains: dict[str, float] = dc.field(default_factory=dict)


@dc.dataclass
class Robot:
    name: str = "mirte"
    start: np.ndarray = dc.field(default_factory=lambda: np.zeros(3))
    wheel: Wheel = dc.field(default_factory=Wheel)


def parse_error(text: str) -> str:
    with pytest.raises(UserError) as caught:
        parse_typed(Robot, text, "robot.yaml")
    message = str(caught.value)
    assert message.startswith("robot.yaml")
    assert "\n" not in message
    return message


def test_missing_fields_keep_their_defaults():
    robot = parse_typed(Robot, "wheel: {radius: 0.1}", "text")
    assert (robot.name, robot.wheel.radius, robot.wheel.gains) == ("mirte", 0.1, {})


def test_missing_fields_keep_given_defaults():
    defaults = Robot(name="other", wheel=Wheel(radius=0.2))
    robot = parse_typed(Robot, "wheel: {gains: {fl: 1.0}}", "text", defaults)
    assert (robot.name, robot.wheel.radius, robot.wheel.gains) == ("other", 0.2, {"fl": 1.0})
    assert defaults.wheel.gains == {}


@pytest.mark.parametrize("text", ["", "just words", "- 1\n- 2", "3"])
def test_text_that_is_no_mapping(text):
    assert parse_error(text) == "robot.yaml: must be a YAML mapping of field: value"


@pytest.mark.parametrize(
    ("text", "line"),
    [("name: a\nstart: [1, 2", 2), ("name: a\n\tstart: 1", 2), ("name: a\n---\nname: b", 2)],
)
def test_bad_yaml_names_the_line(text, line):
    assert parse_error(text).startswith(f"robot.yaml, line {line}: not valid YAML: ")


def test_control_character_is_bad_yaml():
    assert "not valid YAML" in parse_error("name: \x01")


def test_object_tag_is_not_executed():
    assert "not valid YAML" in parse_error("name: !!python/object/apply:os.getcwd []")


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("nam: a", "nam"),
        ("wheel: {radios: 0.1}", "wheel.radios"),
        ("# first\nname: a # b\nwheel:\n  # inside\n  radios: 0.1", "wheel.radios"),
    ],
)
def test_unknown_key_is_named(text, field):
    message = parse_error(text)
    assert message.startswith(f"robot.yaml: {field}: ")
    assert "unknown" in message


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("name: [1]", "name"),
        ("name: 3", "name"),
        ("name: a\nwheel: {gains: {fl: 1.0}, radius: abc}", "wheel.radius"),
        ("wheel: {gains: {fl: 1.0, fr: abc}}", "wheel.gains.fr"),
        ("wheel:\n  radius: |-\n    one\n    two", "wheel.radius"),
        ("wheel: 3", "wheel"),
        ("wheel: null", "wheel"),
        ("wheel: {gains: null}", "wheel.gains"),
        ("start: [1, 2, x]", "start"),
        ("start: [[1, 2], [3]]", "start"),
    ],
)
def test_wrong_type_names_the_path_of_the_field(text, field):
    assert parse_error(text).startswith(f"robot.yaml: {field}: ")


@pytest.mark.parametrize("text", ["name: a\nname: b", "wheel: {gains: {fl: 1.0, fl: 2.0}}"])
def test_key_given_twice_is_an_error(text):
    assert "twice" in parse_error(text)


@pytest.mark.parametrize("text", ["~: 1", "? [a, b]\n: 1", "1: 2"])
def test_key_that_is_no_name(text):
    assert parse_error(text)


def test_mapping_that_contains_itself_does_not_hang():
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("does not end"))
    signal.alarm(3)
    try:
        assert parse_error("wheel: &wheel\n  wheel: *wheel")
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def test_very_deep_nesting():
    assert parse_error("wheel: " + 500 * "[" + 500 * "]")


def test_missing_file_is_named(tmp_path):
    path = tmp_path / "no.yaml"
    with pytest.raises(UserError, match="cannot be read: No such file") as caught:
        load_typed(Robot, path)
    assert str(path) in str(caught.value)


def test_folder_is_no_file(tmp_path):
    with pytest.raises(UserError, match="cannot be read: Is a directory"):
        read_text(tmp_path)


def test_file_that_is_not_utf8(tmp_path):
    path = tmp_path / "latin.yaml"
    path.write_bytes("name: Zoë".encode("latin-1"))
    with pytest.raises(UserError, match=r"latin\.yaml: cannot be read: it is not UTF-8"):
        load_typed(Robot, path)


def test_error_in_a_file_names_the_file(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("nam: a")
    with pytest.raises(UserError, match=r"robot\.yaml: nam: "):
        load_typed(Robot, path)


def test_round_trip_in_a_new_folder(tmp_path):
    path = tmp_path / "new" / "folder" / "robot.yaml"
    robot = Robot("Zoë: #1", np.array([0.1, -1e-17, 1e300]), Wheel(1 / 3, {"fl": 2.0}))
    write_typed(robot, path)
    loaded = load_typed(Robot, path)
    assert (loaded.name, loaded.wheel) == (robot.name, robot.wheel)
    np.testing.assert_array_equal(loaded.start, robot.start)
    assert [p.name for p in path.parent.iterdir()] == ["robot.yaml"]


@pytest.mark.parametrize("target", ["file/robot.yaml", "file/sub/robot.yaml", "folder"])
def test_place_that_cannot_be_written(tmp_path, target):
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError, match=f"{target}: cannot be written: "):
        write_typed(Robot(), tmp_path / target)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_replacing_keeps_the_suffix_and_replaces_the_file(tmp_path):
    path = tmp_path / "log.npz"
    path.write_text("old")
    with replacing(path) as temporary:
        assert temporary.suffix == ".npz"
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("exception", [RuntimeError, KeyboardInterrupt])
def test_replacing_leaves_the_old_file_and_nothing_else_on_an_exception(tmp_path, exception):
    path = tmp_path / "log.npz"
    path.write_text("old")
    with pytest.raises(exception), replacing(path) as temporary:
        temporary.write_text("half")
        raise exception
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@dc.dataclass
class Arm:
    length: float = 0.1


@dc.dataclass
class Equipped:
    tool: Arm | Wheel | None = None
    spare: Wheel | None = dc.field(default_factory=Wheel)


@pytest.mark.parametrize("tool", [None, Arm(0.3), Wheel(0.2)])
@pytest.mark.parametrize("spare", [None, Wheel(0.4)])
def test_what_is_none_of_several_kinds_stays_none(tool, spare, tmp_path):
    file = tmp_path / "equipped.yaml"
    write_typed(Equipped(tool, spare), file)
    defaults = Equipped(Wheel(0.5), Wheel(0.6))
    assert load_typed(Equipped, file, defaults) == Equipped(tool, spare)
