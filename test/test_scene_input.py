"""Obstacles from their topic or from a request."""

from __future__ import annotations

from typing import Any

import pytest
from ff_planner_msgs.msg import Obstacle, ObstacleSphere
from ff_planner_msgs.msg import Scene as SceneMessage
from heard_inputs import HeardScenes
from rclpy.serialization import serialize_message
from shape_msgs.msg import SolidPrimitive

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.errors import InvalidInput, Retry, Status
from ff_planner_ros.ros.inputs import scene_input as scene_input_module
from ff_planner_ros.ros.messages.answers import status_message
from ff_planner_ros.ros.messages.to_messages import target_body_message

FRAME = "inertial"
SECOND = 1_000_000_000


def _scene(
    *radii: float, bodies: tuple[Obstacle, ...] = (), source: str = "vision", sec: int = 12
) -> SceneMessage:
    message = SceneMessage(source=source, bodies=list(bodies))
    message.header.frame_id, message.header.stamp.sec = FRAME, sec
    message.spheres = [ObstacleSphere(id=f"c{i}", radius=radius) for i, radius in enumerate(radii)]
    return message


def _panel(name: str, turning: float = 0.0) -> Obstacle:
    body = Obstacle(id=name)
    body.primitive = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[1.0, 2.0, 0.1])]
    body.twist.angular.z = turning
    return body


@pytest.fixture
def scene_input() -> HeardScenes:
    return HeardScenes()


def _refusal(scene_input: HeardScenes, own: SceneMessage | None = None) -> InvalidInput:
    with pytest.raises(InvalidInput) as refusal:
        scene_input.scene(own)
    return refusal.value


def test_without_any_message_there_is_no_scene(scene_input: HeardScenes) -> None:
    refusal = _refusal(scene_input)
    assert (refusal.status, refusal.field) == (Status.NO_OBSTACLES, "obstacles")
    assert "publish an empty scene" in refusal.allowed


def test_each_message_replaces_the_whole_scene_and_has_its_own_stamp_and_source(
    scene_input: HeardScenes,
) -> None:
    for message, ids in (
        (_scene(0.1, 0.2, bodies=(_panel("panel"),)), ["c0", "c1", "panel"]),
        (_scene(bodies=(_panel("panel"), _panel("mast")), sec=13), ["panel", "mast"]),
        (_scene(0.3, source="operator", sec=14), ["c0"]),
        (_scene(source="", sec=14), []),
    ):
        scene_input.hear(message)
        scene = scene_input.scene()
        assert [one.id for one in scene.obstacles] == ids
        assert scene.stamp_ns == message.header.stamp.sec * SECOND
        assert scene.source == message.source
        assert scene_input.scene() is scene, "it is read once"


@pytest.mark.parametrize("length", [0, 10, 60])
def test_a_damaged_message_is_refused_until_the_next_one(
    scene_input: HeardScenes, length: int
) -> None:
    whole = serialize_message(_scene(0.1, sec=12))
    scene_input.hear(whole[:length])
    refusal = _refusal(scene_input)
    assert (refusal.status, refusal.field) == (Status.OUT_OF_RANGE, "obstacles")
    assert (refusal.value, refusal.allowed) == ("damaged", "it must be of type Scene")
    scene_input.hear(whole)
    assert len(scene_input.scene().obstacles) == 1


def test_a_damaged_target_body_is_refused(scene_input: HeardScenes) -> None:
    scene_input.hear_body(b"\0\1\0\0")
    with pytest.raises(InvalidInput) as refusal:
        scene_input.target_body(None, 0, 1.0, 1.0)
    assert (refusal.value.field, refusal.value.value) == ("target_body", "damaged")


def test_the_newest_stamp_counts_though_an_older_scene_comes_last() -> None:
    scene_input = HeardScenes(lambda: 100 * SECOND)
    for sec in (13, 12, 14, 11):
        message = _scene(0.1, sec=sec)
        scene_input.hear(message)
    assert scene_input.scene().stamp_ns == 14 * SECOND


def test_a_stamp_that_is_left_out_or_ahead_of_now_counts_for_no_longer_than_until_the_next(
    scene_input: HeardScenes,
) -> None:
    scene_input = HeardScenes(lambda: 100 * SECOND)
    for sec in (200, 50, 0, 40, 30):
        scene_input.hear(_scene(sec=sec))
        assert scene_input.scene().stamp_ns == (sec if sec != 30 else 40) * SECOND


def test_a_stamp_with_more_nanoseconds_than_a_second_is_refused(
    scene_input: HeardScenes,
) -> None:
    bad = _scene(0.1)
    bad.header.stamp.nanosec = 2_000_000_000
    scene_input.hear(bad)
    assert _refusal(scene_input).field == "obstacles.header.stamp.nanosec"
    assert _refusal(scene_input, bad).field == "scene.header.stamp.nanosec"


def test_a_requests_own_scene_goes_before_the_one_heard_of_and_is_not_kept(
    scene_input: HeardScenes,
) -> None:
    scene_input.hear(_scene(0.0))  # refused where it counts
    own = scene_input.scene(_scene(0.2, bodies=(_panel("panel"),), sec=14))
    assert [one.id for one in own.obstacles] == ["c0", "panel"]
    assert (own.stamp_ns, own.source) == (14 * SECOND, "scene")
    assert scene_input.scene(_scene()).obstacles == ()
    scene_input.hear(_scene(0.1))
    assert scene_input.scene().source == "vision"


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(
    ("sec", "turning", "status"),
    [
        *((96, 0.1, None), (94, 0.1, Status.STATE_TOO_OLD), (102, 0.1, Status.STATE_IN_FUTURE)),
        *((94, 0.0, None), (1, 0.0, None)),
    ],
)
def test_a_body_that_turns_needs_the_time_when_it_was_there_and_one_at_rest_may_be_of_any(
    scene_input: HeardScenes, own: bool, sec: int, turning: float, status: Status | None
) -> None:
    message = _scene(0.1, bodies=(_panel("panel", turning),), sec=sec)
    if not own:
        scene_input.hear(message)
    asked = (message if own else None, 100 * SECOND, 1.0, 5.0)
    if status is None:
        assert len(scene_input.moving_scene(*asked).obstacles) == 2
        return
    with pytest.raises(InvalidInput) as refused:
        scene_input.moving_scene(*asked)
    field = f"{'scene' if own else 'obstacles'}.header.stamp"
    assert (refused.value.status, refused.value.field) == (status, field)
    # The age of what a request brings only grows.
    is_over = own and status is Status.STATE_TOO_OLD
    assert status_message(refused.value).retry == (Retry.CHANGED if is_over else Retry.LATER)


@pytest.mark.parametrize("where", ["topic", "request"])
@pytest.mark.parametrize(
    ("spoil", "status", "field"),
    [
        ("frame", Status.WRONG_FRAME, "header.frame_id"),
        ("id", Status.OUT_OF_RANGE, "spheres[2].id"),
        ("body", Status.OUT_OF_RANGE, "bodies[1].id"),
        ("radius", Status.OUT_OF_RANGE, "spheres[1].radius"),
        ("center", Status.NOT_FINITE, "spheres[1].center"),
        ("turning", Status.UNSUPPORTED, "spheres[1].twist.angular"),
    ],
)
def test_a_bad_scene_is_told_and_hides_the_good_one_until_the_next_good_one(
    scene_input: HeardScenes, where: str, spoil: str, status: Status, field: str
) -> None:
    scene_input.hear(_scene(0.5))
    bad = _scene(0.1, 0.2, 0.3)
    if spoil == "frame":
        bad.header.frame_id = "map"
    elif spoil == "id":
        bad.spheres[2].id = "c0"
    elif spoil == "body":
        bad.bodies = [_panel("panel"), _panel("c0")]
    elif spoil == "radius":
        bad.spheres[1].radius = 0.0
    elif spoil == "center":
        bad.spheres[1].center.y = float("nan")
    else:
        bad.spheres[1].twist.angular.x = 0.1
    if where == "topic":
        scene_input.hear(bad)
        refusal = _refusal(scene_input)
    else:
        refusal = _refusal(scene_input, bad)
    source = "obstacles" if where == "topic" else "scene"
    assert (refusal.status, refusal.field) == (status, f"{source}.{field}")
    scene_input.hear(_scene(0.4))
    assert [sphere.radius for sphere in scene_input.scene().obstacles] == [0.4]


def test_an_id_given_twice_is_told_with_the_place_of_the_first(
    scene_input: HeardScenes,
) -> None:
    bad = _scene(0.1, 0.2, 0.3)
    bad.spheres[2].id = "c1"
    refusal = _refusal(scene_input, bad)
    assert str(refusal) == (
        "scene.spheres[2].id is 'c1': every id must be given once, and spheres[1] has it already"
    )


def _moving_among_still(sec: int) -> SceneMessage:
    message = _scene(0.1, 0.2, 0.3, sec=sec)
    message.spheres[1].twist.linear.x = -0.5
    return message


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(
    ("sec", "status"),
    [(100, None), (1, None), (101, None), (102, Status.STATE_IN_FUTURE)],
)
def test_one_sphere_that_moves_is_enough_to_need_the_time_when_it_was_there(
    scene_input: HeardScenes, own: bool, sec: int, status: Status | None
) -> None:
    """However long ago, for it moves uniformly; ahead of now by so much at most."""
    message, now_ns = _moving_among_still(sec), 100 * SECOND
    if not own:
        scene_input.hear(message)
    asked = (message if own else None, now_ns, 1.0)
    if status is None:
        assert scene_input.moving_scene(*asked).stamp_ns == sec * SECOND
        return
    with pytest.raises(InvalidInput) as refused:
        scene_input.moving_scene(*asked)
    field = f"{'scene' if own else 'obstacles'}.header.stamp"
    assert (refused.value.status, refused.value.field) == (status, field)


@pytest.mark.parametrize(
    "moving", [_moving_among_still(0), _scene(0.1, bodies=(_panel("panel", 0.1),), sec=0)]
)
def test_without_a_stamp_a_requests_moving_obstacles_are_of_now_and_others_of_nobody_knows_when(
    scene_input: HeardScenes, moving: SceneMessage
) -> None:
    now_ns = 100 * SECOND
    assert scene_input.moving_scene(moving, now_ns, 1.0).stamp_ns == now_ns
    assert scene_input.moving_scene(_scene(0.1, sec=0), now_ns, 1.0).stamp_ns == 0
    scene_input.hear(moving)
    with pytest.raises(InvalidInput, match="when the obstacles that move were there"):
        scene_input.moving_scene(None, now_ns, 1.0)


def test_what_rests_needs_no_time_and_may_be_of_any(scene_input: HeardScenes) -> None:
    for sec in (0, 1, 100_000):
        scene_input.hear(_scene(0.1, sec=sec))
        assert scene_input.moving_scene(None, 100 * SECOND, 1.0).stamp_ns == sec * SECOND


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(
    ("age", "status"),
    [
        *((0.0, None), (4.9, None), (-0.9, None)),
        *((5.1, Status.TARGET_TOO_OLD), (-1.1, Status.TARGET_IN_FUTURE)),
    ],
)
def test_a_target_body_is_as_old_and_as_early_as_it_may_be_and_no_more(
    scene_input: HeardScenes, own: bool, age: float, status: Status | None
) -> None:
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    now_ns = 100 * SECOND
    stamp_ns = now_ns - round(age * SECOND)
    message = target_body_message(body, stamp_ns, FRAME)
    if not own:
        scene_input.hear_body(message)
    asked = (message if own else None, now_ns, 5.0, 1.0)
    if status is None:
        assert scene_input.target_body(*asked).stamp_ns == stamp_ns
        return
    with pytest.raises(InvalidInput) as refused:
        scene_input.target_body(*asked)
    assert (refused.value.status, refused.value.field) == (status, "target_body.header.stamp")
    is_over = own and age > 0.0
    assert status_message(refused.value).retry == (Retry.CHANGED if is_over else Retry.LATER)
    limit, name = ("5", "target_max_age") if age > 0.0 else ("1", "state_future_tolerance")
    assert f"at most {limit} s" in refused.value.allowed
    assert name in refused.value.allowed


@pytest.mark.law("NODE-04")
def test_a_target_body_stamped_ahead_never_becomes_a_measurement_of_now() -> None:
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    now_ns = 100 * SECOND
    scene_input = HeardScenes(lambda: now_ns)

    def refusal() -> InvalidInput:
        with pytest.raises(InvalidInput) as refused:
            scene_input.target_body(None, now_ns, 5.0, 0.05)
        return refused.value

    for _ in range(50):
        scene_input.hear_body(target_body_message(body, now_ns + 3 * SECOND, FRAME))
        assert refusal().status is Status.TARGET_IN_FUTURE
        assert refusal().value == "3.000 s ahead of its arrival"
        now_ns += SECOND // 10
    for _ in range(50):
        now_ns += SECOND // 10
        assert refusal().status is Status.TARGET_IN_FUTURE
    # Of now, once and for all.
    scene_input.hear_body(target_body_message(body, now_ns, FRAME))
    assert scene_input.target_body(None, now_ns, 5.0, 0.05).stamp_ns == now_ns
    # And a clock that is behind is told.
    for _ in range(100):
        now_ns += SECOND // 10
        scene_input.hear_body(target_body_message(body, now_ns - 7 * SECOND, FRAME))
    assert "7.000 s behind this node's" in refusal().allowed


def test_spheres_that_move_are_not_of_now_because_their_stamp_was_ahead() -> None:
    now_ns = 100 * SECOND
    scene_input = HeardScenes(lambda: now_ns)
    scene_input.hear(_moving_among_still(103))
    for now_ns in range(100 * SECOND, 110 * SECOND, SECOND):
        with pytest.raises(InvalidInput, match=r"3\.000 s ahead of its arrival"):
            scene_input.moving_scene(None, now_ns, 0.05)


class Published:
    """Obstacles that are heard at a time."""

    def __init__(self, *names: str) -> None:
        self.now_ns = 1000 * SECOND
        self.input = HeardScenes(lambda: self.now_ns, *names)

    def ask(self) -> Any:
        return self.input.moving_scene(None, self.now_ns, 0.05)

    def refusal(self) -> InvalidInput:
        with pytest.raises(InvalidInput) as refused:
            self.ask()
        return refused.value


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("sec", [989, 1, 1100, 1001])
def test_a_scene_older_than_the_last_or_stamped_ahead_is_refused_aloud(
    sec: int, moves: bool
) -> None:
    published = Published("/mapper")
    array = _moving_among_still if moves else lambda sec: _scene(0.1, sec=sec)
    published.input.hear(array(999))
    assert published.ask().stamp_ns == 999 * SECOND
    published.input.hear(array(sec))
    refusal = published.refusal()
    assert refusal.field == "obstacles.header.stamp"
    if sec < 1000:
        assert refusal.value == f"{999 - sec}.000 s before that of the message before"
    else:
        assert refusal.status is Status.STATE_IN_FUTURE
        assert refusal.value == f"{sec - 1000}.000 s ahead of its arrival"
    if sec < 1000:
        published.input.hear(array(1000))
        assert published.ask().stamp_ns == 1000 * SECOND


def test_of_many_scenes_only_those_that_are_asked_for_are_decoded(
    scene_input: HeardScenes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Thousands of spheres ten times a second would slow down the node."""
    decoded = list[str]()

    def read(message: SceneMessage, *_: Any) -> Any:
        decoded.append(message.source)
        return ()

    monkeypatch.setattr(scene_input_module, "scene_from_message", read)
    for asked in ("first", "second"):
        for number in range(50):
            scene_input.hear(_scene(0.1, source=str(number)))
        scene_input.hear(_scene(0.1, source=asked))
        for _ in range(3):
            assert scene_input.scene().source == asked
    assert decoded == ["first", "second"]


@pytest.mark.law("NODE-06")
def test_two_publishers_of_a_scene_or_target_body_are_refused_by_name() -> None:
    """Whatever they say, and whoever spoke last; who is gone from the graph is no publisher."""
    published = Published("/camera", "/mapper")
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    published.input.hear(_scene(0.1))
    published.input.hear_body(target_body_message(body, published.now_ns, FRAME))

    def ask_for_target() -> Any:
        return published.input.target_body(None, published.now_ns, 5.0, 0.05)

    for ask, topic in ((published.ask, "obstacles"), (ask_for_target, "target_body")):
        with pytest.raises(InvalidInput) as refused:
            ask()
        assert refused.value.status is Status.SEVERAL_PUBLISHERS
        assert (refused.value.field, refused.value.value) == (
            topic,
            "published by /camera and /mapper",
        )
    own = published.input.moving_scene(_scene(0.2), published.now_ns, 0.05)
    assert own.source == "scene", "a request brings its own"
    published.input.middleware.names = ["/mapper"]
    assert len(published.ask().obstacles) == 1
    assert ask_for_target().stamp_ns == published.now_ns


def test_a_publisher_that_the_node_cannot_hear_is_named_where_nothing_was_received() -> None:
    published = Published()
    published.input.middleware.why_unheard = [
        "/mapper offers durability volatile, this node needs transient_local"
    ]
    assert "/mapper offers durability volatile" in published.refusal().allowed
    with pytest.raises(InvalidInput, match="/mapper offers"):
        published.input.target_body(None, 0, 1.0, 1.0)


@pytest.mark.law("NODE-05")
@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(
    ("sec", "max_age", "status"),
    [
        *((96, 5.0, None), (95, 5.0, None), (94, 5.0, Status.STATE_TOO_OLD)),
        *((1, 5.0, Status.STATE_TOO_OLD), (1, 100.0, None)),
        (-2000, 5.0, Status.OUT_OF_RANGE),
    ],
)
def test_an_old_scene_of_what_moves_is_refused_and_not_carried_out_of_the_way(
    own: bool, sec: int, max_age: float, status: Status | None
) -> None:
    now_ns = 100 * SECOND
    scene_input, message = HeardScenes(lambda: now_ns), _moving_among_still(sec)
    if not own:
        scene_input.hear(message)
    asked = (message if own else None, now_ns, 0.05, max_age)
    if status is None:
        assert scene_input.moving_scene(*asked).stamp_ns == sec * SECOND
        return
    with pytest.raises(InvalidInput) as refused:
        scene_input.moving_scene(*asked)
    field = f"{'scene' if own else 'obstacles'}.header.stamp"
    assert refused.value.status is status
    assert refused.value.field == (field if sec > 0 else f"{field}.sec")
    if sec > 0:
        assert "at most 5 s old (parameter obstacles_max_age)" in refused.value.allowed
    still = _scene(0.1, sec=max(sec, 0))
    scene_input.hear(still)
    assert scene_input.moving_scene(None, now_ns, 0.05, max_age).obstacles, "of any age"


def test_latched_obstacles_may_come_as_long_as_discovery_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown = [1000.0]
    monkeypatch.setattr(scene_input_module.time, "monotonic", lambda: shown[0])
    published = Published()
    for names, seconds, may_come in (
        ([], 0.0, True),
        ([], 4.9, True),
        ([], 5.1, False),
        (["/mapper"], 5.1, True),
        (["/mapper"], 14.9, True),
        (["/mapper"], 15.1, False),
    ):
        published.input.middleware.names, shown[0] = names, 1000.0 + seconds
        assert published.input.may_come() is may_come
    shown[0] = 1000.0
    published.input.hear(_scene())
    assert not published.input.may_come()
