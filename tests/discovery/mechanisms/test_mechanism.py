"""A user's MJCF is read, bounded, and nothing in it is executed."""

from pathlib import Path

import pytest
from small_mechanism import CART, PENDULUM

from pipeline.discovery.mechanisms.mechanism import read_mechanism
from pipeline.errors import SceneError

BODY = '<body><joint name="j"/><geom size="0.1"/></body>'


def model(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    return path


def test_joints_actuators_and_bodies_are_found_by_name(tmp_path: Path) -> None:
    found = read_mechanism(model(tmp_path, CART))
    (joint,) = found.joints
    assert (joint.name, joint.slide, joint.unit) == ("slide", True, "m")
    assert found.actuators == ("push",) and found.bodies == ("cart",)
    assert read_mechanism(model(tmp_path, PENDULUM)).joints[0].unit == "rad"


def test_files_in_the_models_folder_may_be_included(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "body.xml").write_text(f"<mujocoinclude>{BODY}</mujocoinclude>")
    text = '<mujoco><worldbody><include file="parts/body.xml"/></worldbody></mujoco>'
    assert [j.name for j in read_mechanism(model(tmp_path, text)).joints] == ["j"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<mujoco><worldbody>", "not XML"),
        ("<robot/>", "outermost"),
        ("<mujoco><worldbody/></mujoco>", "no joint"),
        (
            '<mujoco><worldbody><body><joint axis="0 0 0"/><geom size="1"/></body></worldbody></mujoco>',
            "cannot compile",
        ),
        ('<mujoco><worldbody><include file="../other.xml"/></worldbody></mujoco>', "outside"),
        ('<mujoco><worldbody><include file="/etc/hostname"/></worldbody></mujoco>', "outside"),
        ('<mujoco><asset><mesh name="m" file="../m.stl"/></asset><worldbody/></mujoco>', "outside"),
        (
            '<mujoco><compiler meshdir=".."/><asset><mesh name="m" file="m.stl"/></asset><worldbody/></mujoco>',
            "outside",
        ),
        ('<mujoco><asset><mesh name="m" file="none.stl"/></asset><worldbody/></mujoco>', "no such file"),
        ('<mujoco><extension><plugin plugin="mujoco.pid"/></extension><worldbody/></mujoco>', "not allowed"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><mujoco/>', "entities"),
        (f'<mujoco><worldbody><replicate count="1000000">{BODY}</replicate></worldbody></mujoco>', "copies"),
        ('<mujoco><size memory="100G"/><worldbody/></mujoco>', "memory"),
        ("<mujoco><worldbody>" + 2001 * "<body/>" + "</worldbody></mujoco>", "2,001 bodies"),
    ],
)
def test_what_may_not_be_read_is_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(SceneError, match=says) as error:
        read_mechanism(model(tmp_path, text))
    assert "\n" not in str(error.value) and "robot.xml" in str(error.value)


def test_files_that_include_each_other_end(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="include each other"):
        read_mechanism(model(tmp_path, '<mujoco><include file="robot.xml"/></mujoco>'))
