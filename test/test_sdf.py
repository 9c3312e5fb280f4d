"""Models in SDFormat: the same body or robot as the URDF that says the same, or a refusal in words.

Where frames are follows from the format's own definitions, written out here with other code.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import canonicalize

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from test_target_urdf import URDF, body_alone, scenario_with_urdf, tetrahedron
from test_tumbling import body_of

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.collision.urdf_body import UrdfBody, urdf_body
from ff_planner_ros.robot.model import load_robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.sdf import urdf_of
from ff_planner_ros.robot.urdf.sdf_model import SDF as SDF_FORMAT
from ff_planner_ros.ros.messages.from_messages import target_body_from_message
from ff_planner_ros.ros.messages.to_messages import target_body_message

# What the URDF of `test_target_urdf` says. The link of the panel stands off its joint, and the
# antenna's place is told in another frame.
SDF = """<?xml version="1.0"?>
<sdf version="1.9" xmlns:of="somebody">
  <model name="client">
    <pose>7 8 9 0 0 1</pose>
    <static>false</static>
    <link name="bus">
      <inertial>
        <pose>0.1 0 0 0.3 0 0</pose><mass>100</mass>
        <inertia><ixx>10</ixx><iyy>12</iyy><izz>8</izz><ixy>0.5</ixy></inertia>
      </inertial>
      <collision name="a">
        <geometry><box><size>1 0.8 0.6</size></box></geometry>
        <surface><friction/></surface>
      </collision>
      <collision name="b">
        <pose degrees="true">0 0 0.5 0 85.943669269623478 0</pose>
        <geometry><cylinder><radius>0.2</radius><length>0.3</length></cylinder></geometry>
      </collision>
      <visual name="seen"><geometry><plane><normal>0 0 1</normal></plane></geometry></visual>
    </link>
    <frame name="root" attached_to="bus"><pose>0 0.4 0 0 0.2 0</pose></frame>
    <link name="panel">
      <pose relative_to="root">0 0.6 0 0 0 0</pose>
      <inertial>
        <pose>0 0.4 0 0 0 0</pose><mass>20</mass>
        <inertia><ixx>6</ixx><iyy>1</iyy><izz>7</izz></inertia>
      </inertial>
      <collision name="c">
        <pose relative_to="drive">0 1 0 0 0 0</pose>
        <geometry><box><size>0.5 2 0.02</size></box></geometry>
      </collision>
    </link>
    <link name="antenna">
      <pose relative_to="drive">0 2.2 0 0 0 0</pose>
      <inertial><mass>0</mass>
        <inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial>
      <collision name="d"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision>
      <collision name="e"><geometry><empty/></geometry></collision>
      <of:thing><anything/></of:thing>
    </link>
    <joint name="drive" type="revolute">
      <pose>0 -0.6 0 0 0 0</pose>
      <parent>bus</parent><child>panel</child>
      <axis><xyz>0 1 0</xyz><limit><lower>0.5</lower><upper>1</upper></limit></axis>
    </joint>
    <joint name="mast" type="fixed"><parent>panel</parent><child>antenna</child></joint>
    <plugin name="p" filename="f"><model/></plugin>
  </model>
</sdf>
"""


def require_same(found: UrdfBody, expected: UrdfBody) -> None:
    assert found.mass == pytest.approx(expected.mass, rel=1e-12)
    assert found.inertia == pytest.approx(expected.inertia, abs=1e-9)
    assert [one.name for one in found.solids] == [one.name for one in expected.solids]
    for one, other in zip(found.solids, expected.solids, strict=True):
        assert one.place.homogeneous == pytest.approx(other.place.homogeneous, abs=1e-9)
        assert one.solid.words == other.solid.words


def test_an_sdf_is_the_body_that_the_same_urdf_is() -> None:
    require_same(urdf_body(SDF, "it"), urdf_body(URDF, "it"))
    assert urdf_of(URDF) == URDF


def test_a_robot_of_an_sdf_has_the_bodies_that_the_same_urdf_has() -> None:
    limited = "<effort>1</effort><velocity>1</velocity></limit>"
    told = SDF.replace("</limit>", limited)
    ours, same = (robot_from_urdf_text(text, "bus", "panel") for text in (told, urdf_of(told)))
    assert ours.geometry is Geometry.SHAPES
    names = [body.name for body in ours.bodies]
    assert names == [body.name for body in same.bodies] == ["bus", "bus#2", "panel", "antenna"]
    assert ours.pairs == same.pairs


def test_a_model_in_a_world_is_the_same_model() -> None:
    """As simulators save it, with what is around it."""
    around = "<gravity>0 0 -9.8</gravity><physics/><scene/><gui/><light name='sun'/><state/>"
    world = SDF.replace('<model name="client">', f'<world name="w">{around}<model name="client">')
    world = world.replace("</model>\n</sdf>", "</model></world></sdf>")
    require_same(urdf_body(world, "it"), urdf_body(SDF, "it"))


def test_an_axis_may_be_told_in_the_model_s_frame() -> None:
    """By a word of its own before version 1.7, later by the name of that frame."""
    turned = SDF.replace("<pose>0 -0.6 0 0 0 0</pose>", "<pose>0 -0.6 0 0.3 -0.5 0.7</pose>")
    earlier = turned.replace("<axis>", "<axis><use_parent_model_frame>1</use_parent_model_frame>")
    later = turned.replace("<xyz>", '<xyz expressed_in="__model__">')
    require_same(urdf_body(earlier, "it"), urdf_body(later, "it"))
    with pytest.raises(AssertionError):
        require_same(urdf_body(earlier, "it"), urdf_body(turned, "it"))


def test_a_joint_with_a_spring_alone_or_what_other_joints_have_is_a_robot_s() -> None:
    """Pinocchio's reader refuses a `<dynamics>` with neither damping nor friction."""
    limited = "<effort>1</effort><velocity>1</velocity></limit>"
    spring = "<dynamics><spring_reference>0</spring_reference><spring_stiffness>0"
    spring += "</spring_stiffness></dynamics>"
    told = SDF.replace("</limit>", limited + spring)
    told = told.replace("<axis>", "<thread_pitch>1</thread_pitch><axis2/><axis>")
    robot = robot_from_urdf_text(told, "bus", "panel", geometry=Geometry.LINES)
    assert (robot.joints, robot.notes) == (1, ())


def test_damping_friction_and_springs_of_an_sdf_are_noted() -> None:
    """Beside torques, in which a plan does not count them."""
    dynamics = (
        "<dynamics><damping>0.5</damping><friction> 2 </friction>"
        "<spring_reference>1</spring_reference><spring_stiffness>30</spring_stiffness></dynamics>"
    )
    limited = "<effort>1</effort><velocity>1</velocity></limit>"
    robot = SDF.replace("</limit>", limited + dynamics)
    (note,) = robot_from_urdf_text(urdf_of(robot), "bus", "panel", geometry=Geometry.LINES).notes
    told = "drive damping 0.5 N m s/rad, friction 2 N m, stiffness 30 N m/rad"
    assert note == f"not counted in the torques of joints: {told}"
    require_same(urdf_body(robot, "it"), urdf_body(URDF, "it"))


def test_messages_and_scenarios_may_have_it(tmp_path: Path) -> None:
    message = target_body_message(body_alone(), 0, "inertial")
    message.urdf = SDF
    read = target_body_from_message(message, "inertial")
    assert [one.id for one in read.obstacles] == ["antenna", "bus", "bus#2", "panel"]
    scenario = scenario_with_urdf(tmp_path, urdf="client/model.sdf")
    (tmp_path / "client/model.sdf").write_text(SDF, encoding="utf-8")
    of_sdf = body_of(load_scenario(scenario))
    of_urdf = body_of(load_scenario(scenario_with_urdf(tmp_path)))
    assert of_sdf.inertia == pytest.approx(of_urdf.inertia, abs=1e-9)
    for one, other in zip(of_sdf.obstacles, of_urdf.obstacles, strict=True):
        assert one.id == other.id
        assert one.position == pytest.approx(other.position, abs=1e-9)


@pytest.mark.parametrize("uri", ["bus.stl", "model://client/bus.stl", "package://client/bus.stl"])
def test_a_mesh_is_found_beside_the_model(tmp_path: Path, uri: str) -> None:
    scenario = scenario_with_urdf(tmp_path, urdf="client/model.sdf")
    tetrahedron(tmp_path / "client/bus.stl")
    mesh = f"<mesh><uri>{uri}</uri><scale>0.5 -0.7 0.9</scale></mesh>"
    text = SDF.replace("<box><size>1 0.8 0.6</size></box>", mesh)
    (tmp_path / "client/model.sdf").write_text(text, encoding="utf-8")
    (bus,) = [one for one in body_of(load_scenario(scenario)).obstacles if one.id == "bus"]
    assert isinstance(bus.shape, Solid)
    for corner in ((0, 0, 0), (0.5, 0, 0), (0, -0.7, 0), (0, 0, 0.9)):
        assert np.linalg.norm(bus.shape.corners - np.array(corner), axis=1).min() < 1e-7


def _drawn_pose(rng: np.random.Generator) -> tuple[Array, str]:
    """Return a pose, and how the format writes it: in one of its three ways."""
    place, turn = rng.normal(size=3), Rotation.random(random_state=rng)
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turn.as_matrix(), place
    numbers, form = turn.as_euler("xyz"), ""
    match rng.integers(3):
        case 1:
            numbers, form = np.degrees(numbers), ' degrees="true"'
        case 2:
            numbers, form = turn.as_quat(), ' rotation_format="quat_xyzw"'
    return made, f"<pose{form}%s>{' '.join(map(repr, [*place.tolist(), *numbers.tolist()]))}</pose>"


@pytest.mark.parametrize("seed", range(20))
def test_each_solid_is_where_the_chain_of_its_frames_says(seed: int) -> None:
    """Links in the model, in frames, in links and in joints, each told before or after those."""
    rng = np.random.default_rng(seed)
    places, parts, links = {"__model__": np.eye(4)}, list[str](), list[str]()
    solids = dict[str, Array]()
    for number in range(8):
        above = str(rng.choice(list(places)))
        pose, text = _drawn_pose(rng)
        if number % 2:
            places[f"f{number}"] = places[above] @ pose
            told = text % (f' relative_to="{above}"' if number % 4 == 1 else "")
            owner = f' attached_to="{above}"' if number % 4 == 3 else ""
            parts.append(f'<frame name="f{number}"{owner}>{told}</frame>')
            continue
        name = f"l{number}"
        places[name] = places[above] @ pose
        of_solid, where = _drawn_pose(rng)
        elsewhere = str(rng.choice(list(places)))
        solids[name] = places[elsewhere] @ of_solid
        parts.append(
            f'<link name="{name}">{text % f" relative_to={above!r}"}'
            f"<inertial><mass>{number + 1}</mass>"
            "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
            f'<collision name="c">{where % f" relative_to={elsewhere!r}"}'
            "<geometry><box><size>1 2 3</size></box></geometry></collision></link>"
        )
        if links:
            of_joint, where = _drawn_pose(rng)
            places[f"j{number}"] = places[name] @ of_joint
            parts.append(
                f'<joint name="j{number}" type="fixed">{where % ""}'
                f"<parent>{rng.choice(links)}</parent><child>{name}</child></joint>"
            )
        links.append(name)
    rng.shuffle(parts)
    found = urdf_body(f"<sdf version='1.7'><model name='m'>{''.join(parts)}</model></sdf>", "it")
    masses = np.array([int(link[1:]) + 1.0 for link in links])
    root = np.linalg.inv(places[links[0]])
    centers = np.array([(root @ places[link])[:3, 3] for link in links])
    center = masses @ centers / masses.sum()
    assert found.mass == pytest.approx(masses.sum())
    for one in found.solids:
        expected = root @ solids[one.name]
        expected[:3, 3] -= center
        assert one.place.homogeneous == pytest.approx(expected, abs=1e-7)


ARM = """
<sdf version="1.8"><model name="arm">
  <link name="base"><pose>1 2 3 0.3 0 0</pose>{inertial}</link>
  <link name="upper"><pose>1 2 4 0 0 0.5</pose>{inertial}</link>
  <link name="hand"><pose relative_to="upper">0.2 0 1 0 0 0</pose>{inertial}</link>
  <joint name="j1" type="revolute"><pose>0.1 0 -0.5 0 0.4 0</pose>
    <parent>base</parent><child>upper</child>
    <axis><xyz>0 0.6 0.8</xyz>
      <limit><lower>-1</lower><upper>2</upper><velocity>0.5</velocity><effort>-1</effort></limit>
    </axis></joint>
  <joint name="j2" type="revolute"><parent>upper</parent><child>hand</child>
    <axis><xyz expressed_in="__model__">1 0 0</xyz>
      <limit><lower>-inf</lower><upper>1e16</upper><velocity>0.7</velocity><effort>9</effort></limit>
    </axis></joint>
</model></sdf>
""".replace(
    "{inertial}",
    "<inertial><mass>5</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>",
)


def test_a_robot_moves_about_the_axes_of_its_sdf(tmp_path: Path) -> None:
    (tmp_path / "arm.sdf").write_text(ARM, encoding="utf-8")
    robot = load_robot(tmp_path / "arm.sdf", "base", "hand")
    assert robot.joint_names == ("j1", "j2")
    assert robot.lower_position_limits == pytest.approx([-1.0, -4 * np.pi])
    assert robot.upper_position_limits == pytest.approx([2.0, 4 * np.pi])
    assert robot.velocity_limits == pytest.approx([0.5, 0.7])
    assert robot.effort_limits.tolist() == [np.inf, 9.0]

    def pose(x: float, y: float, z: float, *rpy: float) -> Array:
        made = np.eye(4)
        made[:3, 3], made[:3, :3] = (x, y, z), Rotation.from_euler("xyz", rpy).as_matrix()
        return made

    def turn(about: Array, axis: list[float], angle: float) -> Array:
        turned = np.eye(4)
        turned[:3, :3] = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
        return about @ turned @ np.linalg.inv(about)

    base, upper = pose(1, 2, 3, 0.3, 0, 0), pose(1, 2, 4, 0, 0, 0.5)
    hand = upper @ pose(0.2, 0, 1, 0, 0, 0)
    first = upper @ pose(0.1, 0, -0.5, 0, 0.4, 0)
    second = np.eye(4)
    second[:3, 3] = hand[:3, 3]
    data, model = robot.model.createData(), robot.model
    for angles in ([0.0, 0.0], [0.7, -0.4], [-1.0, 2.0]):
        q = pin.neutral(model)
        q[7:] = angles
        pin.framesForwardKinematics(model, data, q)
        found = data.oMf[model.getFrameId("base")].inverse() * data.oMf[model.getFrameId("hand")]
        moved = (
            turn(first, [0.0, 0.6, 0.8], angles[0]) @ turn(second, [1.0, 0.0, 0.0], angles[1])
        ) @ hand
        assert found.homogeneous == pytest.approx(np.linalg.inv(base) @ moved, abs=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('version="1.9"', 'version="1.4"', "sdf version is '1.4': it must be from 1.5 on"),
        ('version="1.9"', "", "sdf version is ''"),
        ("<link name=", "<include/><link name=", "<include> is in <model>"),
        ('<model name="client">', '<actor name="w"/><model name="client">', "<actor> is in <sdf>"),
        (
            '<model name="client">',
            '<world><model name="a"/></world><model name="client">',
            "2 models",
        ),
        ("</model>\n</sdf>", '</model><model name="b"/></sdf>', "2 models"),
        ("<size>1 0.8 0.6</size>", "<size>1 0.8</size>", "link 'bus' collision box size"),
        ("<sphere><radius>0.1</radius></sphere>", "<plane/>", "<plane> is in <geometry>"),
        ("<sphere><radius>0.1</radius></sphere>", "<ellipsoid/>", "<ellipsoid> is in <geometry>"),
        ("<sphere><radius>0.1</radius></sphere>", "", "geometry is 0 shapes"),
        ("<sphere><radius>0.1</radius></sphere>", "<mesh/>", "mesh uri is missing"),
        ("<mass>100</mass>", "", "link 'bus' mass is missing"),
        ("<ixx>10</ixx>", "", "link 'bus' inertia ixx is missing"),
        ("<mass>100</mass>", "<mass>heavy</mass>", "link 'bus' mass is 'heavy'"),
        ('type="revolute"', 'type="ball"', "joint 'drive' is ball"),
        ("<parent>bus</parent>", "<parent>world</parent>", "joint 'drive' parent is world"),
        ("<axis>", "<axis><mimic joint='x'/>", "<mimic> is in <axis>"),
        ("<axis>", "<axis3/><axis>", "<axis3> is in <joint>"),
        ("<xyz>0 1 0</xyz>", "<xyz>0 1</xyz>", "joint 'drive' axis xyz is '0 1'"),
        ("<xyz>", "<xyz expressed_in='moon'>", "relative_to is 'moon'"),
        ("0 0.6 0 0 0 0", "0 0.6 0 0 0", "link 'panel' pose is '0 0.6 0 0 0'"),
        ("0 0.6 0 0 0 0", "0 0.6 0 0 0 1e400", "link 'panel' pose"),
        ('relative_to="root"', 'relative_to="moon"', "frame 'panel' relative_to is 'moon'"),
        ('relative_to="root"', 'frame="bus"', "link 'panel' pose frame is bus"),
        ('relative_to="root"', 'relative_to="antenna"', "is in a ring of frames"),
        ('relative_to="root"', 'rotation_format="matrix"', "rotation_format is matrix"),
        ('<link name="antenna">', '<link name="bus">', "link 'bus'"),
        ('<link name="antenna">', "<link>", "link is nameless"),
        ("<inertial>", '<inertial auto="true">', "link 'bus' inertial auto is true"),
        ("<sdf", '<!DOCTYPE a [<!ENTITY b "c">]><sdf', "DOCTYPE"),
        ("<inertial>", "<inertial/><inertial>", "<inertial> is there twice in <link>: it must be"),
        ("<mass>", "<mass>5</mass><mass>", "<mass> is there twice in <inertial>"),
        ("<xyz>0 1", "<xyz>1 0 0</xyz><xyz>0 1", "<xyz> is there twice in <axis>"),
        ("<child>", "<child>bus</child><child>", "<child> is there twice in <joint>"),
        ("<geometry><box", "<geometry><sphere/><box", "geometry is 2 shapes: it must be one of"),
        ("relative_to=", "relativ_to=", "<pose> is with an unknown 'relativ_to': it may have rel"),
        ("<xyz>", "<xyz expresed_in='root'>", "<xyz> is with an unknown 'expresed_in'"),
        ("<mass>", "<mass unit='g'>", "<mass> is with an unknown 'unit': it may have no attrib"),
        ("<of:thing>", "<xacro:thing>", "is with <xacro:thing>, which is not expanded: run xacro"),
        ("<of:thing><anything/>", "<of:thing><link/>", "<of:thing> is unknown, and holds <link>"),
        ("</sdf>", "", "not XML"),
        ('<joint name="mast" type="fixed">', '<joint name="mast" type="fixed"><of2/>', "<of2>"),
    ],
)
def test_what_a_urdf_cannot_say_or_nobody_can_read_is_refused_by_name(
    old: str, new: str, words: str
) -> None:
    assert old in SDF
    with pytest.raises(InvalidInput) as refused:
        urdf_body(SDF.replace('<?xml version="1.0"?>\n', "").replace(old, new, 1), "the file")
    assert words in str(refused.value)
    assert refused.value.field.startswith("the file")
    assert refused.value.status is Status.OUT_OF_RANGE


def test_all_faults_of_an_sdf_are_told_in_one_run_each_with_its_line() -> None:
    changes = (
        ("<mass>20</mass>", "<mass unit='g'>20</mass>", "<mass> is with an unknown 'unit'"),
        ("<axis>", "<axis3/><axis>", "<axis3> is in <joint>"),
        ("<xyz>0 1 0</xyz>", "<xyz>0 1</xyz>", "joint 'drive' axis xyz is '0 1'"),
        ('relative_to="root"', 'relative_to="moon"', "frame 'panel' relative_to is 'moon'"),
        ("<geometry><sphere>", "<geometry><box/><sphere>", "collision geometry is 2 shapes"),
    )
    text = SDF
    for old, new, _ in changes:
        text = text.replace(old, new, 1)
    with pytest.raises(InvalidInput) as refused:
        urdf_body(text, "the file")
    told = str(refused.value)
    assert told.startswith(f"the file is at fault in {len(changes)} places")
    for _, new, words in changes:
        line = 1 + text[: text.index(new)].count("\n")
        if words.startswith("frame"):
            line -= 1  # its link begins one line earlier
        assert re.search(rf"{re.escape(words)}[^;]*\(line {line}\)", told), (words, told)


def test_what_a_urdf_reader_finds_in_an_sdf_has_its_line_there() -> None:
    for old, new, words in (
        ("<mass>100<", "<mass>heavy<", "link 'bus' mass is 'heavy'"),
        ("<size>1 0.8 0.6<", "<size>1 0.8<", "link 'bus' collision box size is"),
        ("<parent>bus<", "<parent>world<", "joint 'drive' parent is world"),
    ):
        text = SDF.replace(old, new, 1)
        line = 1 + text[: text.index(new)].count("\n")
        with pytest.raises(InvalidInput) as refused:
            urdf_body(text, "the file")
        found = re.search(rf"{words}.*\(line (\d+)", str(refused.value))
        assert found
        assert int(found[1]) == line, words


@pytest.mark.parametrize("tag", ["model", "link", "joint", "collision", "inertial", "axis"])
def test_what_the_table_of_the_format_says_is_not_read_changes_no_body(tag: str) -> None:
    rows = {path.rpartition("/")[2]: row for path, row in SDF_FORMAT.tag.within("sdf")}
    for name in rows[tag].unread:
        if name == "pose" or name.startswith("@"):
            continue  # the model's own has one
        text = re.sub(rf"(<{tag}\b[^>]*>)", rf"\1<{name}><any>1</any></{name}>", SDF)
        assert text != SDF
        require_same(urdf_body(text, "it"), urdf_body(URDF, "it"))


def test_a_link_without_an_inertial_is_not_taken_for_a_kilogram() -> None:
    light = "<sdf version='1.9'><model name='m'><link name='a'/></model></sdf>"
    with pytest.raises(InvalidInput, match="link 'a' inertial is missing"):
        urdf_body(light, "it")


def test_a_file_made_to_do_harm_is_refused_at_once() -> None:
    """Deep, wide, in a ring of a thousand frames, and of a thousand frames in a row."""
    model = "<sdf version='1.9'><model name='m'>{}</model></sdf>"
    link = (
        "<link name='a'><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz>"
        "</inertia></inertial></link>"
    )
    deep = model.format("<visual>" + "<a>" * 100_000 + "</a>" * 100_000 + "</visual>" + link)
    assert urdf_body(deep, "it").mass == 1.0
    wide = model.format("<frame name='f'/>" * 100_000)
    with pytest.raises(InvalidInput, match="at most 50000 elements"):
        urdf_body(wide, "it")

    def frames(last: str) -> str:
        row = "".join(f"<frame name='f{n}' attached_to='f{n + 1}'/>" for n in range(10_000))
        return model.format(f"{row}<frame name='f10000' attached_to='{last}'/>{link}").replace(
            "<link name='a'>", "<link name='a'><pose relative_to='f0'/>"
        )

    assert urdf_body(frames("__model__"), "it").mass == 1.0
    with pytest.raises(InvalidInput, match="in a ring of frames"):
        urdf_body(frames("f0"), "it")
    many = "".join(link.replace("'a'", f"'a{n}'") for n in range(1500))
    with pytest.raises(InvalidInput, match="links"):
        urdf_body(model.format(many), "it")


def test_any_sdf_is_a_body_or_a_refusal_in_words(times: Callable[[int, int], int]) -> None:
    """Characters and elements changed at random."""
    read = 0
    for number in range(times(300, 20_000)):
        chance = random.Random(number)
        text = chance.choice((SDF, ARM))
        for _ in range(chance.choice((1, 1, 3))):
            place, other = chance.randrange(len(text)), chance.randrange(len(text))
            length = chance.choice((0, 1, 1, 4, 60))
            written = (chr(chance.randrange(1, 0xD800)), text[other : other + length], "1e308")
            text = text[:place] + chance.choice(written) + text[place + length :]
        answer = body_or_refusal(text)
        if isinstance(answer, InvalidInput):
            assert len(str(answer)) < 1000, number
        else:
            read += 1
            assert np.isfinite(answer.inertia).all(), number
    assert read


def body_or_refusal(text: str) -> UrdfBody | InvalidInput:
    try:
        return urdf_body(text, "it")
    except InvalidInput as error:
        return error


@pytest.mark.parametrize("limit", ["-1", "inf", "1e16", None])
def test_a_velocity_limit_may_be_none_in_each_of_the_words_of_the_format(
    tmp_path: Path, limit: str | None
) -> None:
    written = "" if limit is None else f"<velocity>{limit}</velocity>"
    for name, text in (
        ("none", ARM.replace("<velocity>0.5</velocity>", written)),
        ("no limit", re.sub("<limit>.*0.5.*</limit>", "", ARM)),
    ):
        (tmp_path / f"{name}.sdf").write_text(text, encoding="utf-8")
        robot = load_robot(tmp_path / f"{name}.sdf", "base", "hand")
        assert robot.velocity_limits.tolist() == [np.inf, 0.7], name
        assert robot.effort_limits.tolist() == [np.inf, 9.0], name


def test_a_refusal_says_of_a_limit_what_stands_there() -> None:
    for kind, found, words in (
        ("revolute", "<lower>-1<", "limit upper is 'inf': it must be a finite number"),
        ("prismatic", "<lower>-1<", "limit upper is 'inf': it must be a finite number"),
        ("prismatic", "<lower>-1e16<", "limit lower is -1e+16: its size must be at most"),
    ):
        slide = ARM.replace("<lower>-1<", found).replace("<upper>2<", "<upper>inf<")
        slide = slide.replace('name="j1" type="revolute"', f'name="j1" type="{kind}"')
        with pytest.raises(InvalidInput) as refused:
            robot_from_urdf_text(urdf_of(slide), "base", "hand")
        assert words in str(refused.value)


def test_a_robot_that_is_recorded_is_a_urdf(tmp_path: Path) -> None:
    (tmp_path / "arm.sdf").write_text(ARM, encoding="utf-8")
    robot = load_robot(tmp_path / "arm.sdf", "base", "hand")
    again = robot_from_urdf_text(robot.urdf, "base", "hand")
    assert canonicalize(again.urdf) == canonicalize(robot.urdf)
    assert "<sdf" not in robot.drawn_urdf
