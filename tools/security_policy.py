"""The SROS2 policy of the planner, from the table of its interfaces. Run as a script, it writes it.

It is in the format of sros2's `policy.xsd`, version 0.2.0.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from ff_planner_ros.ros.topics import ACTION, INPUTS, OUTPUTS, ROBOT_MODEL, SERVICES

SOURCE_TREE = Path(__file__).resolve().parents[1]
POLICY = SOURCE_TREE / "config" / "security" / "policy.xml"
HEADER = """\
<?xml version="1.0" encoding="UTF-8"?>
<!-- Who may do what with the planner; docs/how_to/security.md says how to use it. Made by
     tools/security_policy.py from the table of ff_planner_ros/ros/topics.py. -->
"""
NODE, RECORDER = "ff_planner", "ff_planner_recorder"
PUBLISH, SUBSCRIBE, REPLY, REQUEST = "publish", "subscribe", "reply", "request"
EXECUTE, CALL = "execute", "call"
# What a rule speaks of, in the order of a profile.
ELEMENTS = {PUBLISH: "topic", SUBSCRIBE: "topic", REPLY: "service", REQUEST: "service"} | {
    EXECUTE: "action",
    CALL: "action",
}
# What every rclpy node and every lifecycle node has.
OF_NODES: tuple[str, ...] = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
)
OF_NODES += ("set_parameters", "set_parameters_atomically")
TYPES = ("get_type_description",)
OF_LIFECYCLE: tuple[str, ...] = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
)
OF_LIFECYCLE += ("get_transition_graph",)
# By what the node does with them.
INTERFACES = {"subscribes": INPUTS, "publishes": OUTPUTS, "service": SERVICES, "action": (ACTION,)}


class Rule(NamedTuple):
    """What a node is allowed to do with one topic, service or action."""

    what: str
    name: str


def profiles() -> dict[str, set[Rule]]:
    """Return the rules of every node, by its name; names as the node itself would write them."""
    found: dict[str, set[Rule]] = defaultdict(set)
    heard: set[str] = set()  # by whoever may see everything
    for direction, table in INTERFACES.items():
        mine, theirs = {
            "subscribes": (SUBSCRIBE, PUBLISH),
            "publishes": (PUBLISH, SUBSCRIBE),
            "service": (REPLY, REQUEST),
            "action": (EXECUTE, CALL),
        }[direction]
        for one in table:
            found[NODE].add(Rule(mine, one.name))
            # Of others, `~` is another node.
            found[one.peer].add(Rule(theirs, one.name.replace("~", NODE)))
            if direction in ("subscribes", "publishes"):
                heard.add(one.name)
    for name in ("executive", "screen"):
        found[name] |= {Rule(SUBSCRIBE, topic) for topic in heard}
    found[NODE] |= {Rule(PUBLISH, "~/transition_event")}
    found[NODE] |= {Rule(REPLY, f"~/{one}") for one in OF_LIFECYCLE}
    events = {"/rosout", "/parameter_events", f"{NODE}/transition_event"}
    # A bag attaches the model.
    recorded = (heard | events) - {ROBOT_MODEL.name, "/parameter_events"}
    found[RECORDER] |= {Rule(SUBSCRIBE, topic) for topic in recorded}
    found["operator"] |= {Rule(SUBSCRIBE, topic) for topic in events}
    found["operator"] |= {Rule(REQUEST, f"{NODE}/{one}") for one in OF_NODES + OF_LIFECYCLE}
    for name, rules in found.items():
        rules |= {Rule(PUBLISH, "/parameter_events"), Rule(SUBSCRIBE, "/clock")}
        rules |= {Rule(REPLY, f"~/{one}") for one in TYPES}
        if name != RECORDER:
            rules |= {Rule(REPLY, f"~/{one}") for one in OF_NODES} | {Rule(PUBLISH, "/rosout")}
    return found


def policy() -> str:
    """Return the policy: the planner and its recorder share a process, and so an enclave."""
    found = profiles()
    root = ElementTree.Element("policy", version="0.2.0")
    enclaves = ElementTree.SubElement(root, "enclaves")
    others = sorted(found.keys() - {NODE, RECORDER})
    for members in ([NODE, RECORDER], *([name] for name in others)):
        enclave = ElementTree.SubElement(enclaves, "enclave", path=f"/{members[0]}")
        inside = ElementTree.SubElement(enclave, "profiles")
        for name in members:
            profile = ElementTree.SubElement(inside, "profile", ns="/", node=name)
            for what, element in ELEMENTS.items():
                names = sorted(rule.name for rule in found[name] if rule.what == what)
                if names:
                    block = ElementTree.SubElement(profile, f"{element}s", {what: "ALLOW"})
                    for one in names:
                        ElementTree.SubElement(block, element).text = one
    ElementTree.indent(root)
    return f"{HEADER}{ElementTree.tostring(root, encoding='unicode')}\n"


if __name__ == "__main__":
    POLICY.parent.mkdir(exist_ok=True)
    POLICY.write_text(policy(), encoding="utf-8")
