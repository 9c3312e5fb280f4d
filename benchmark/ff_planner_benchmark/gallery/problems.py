"""The published problems in words: where they are from, what is left open, and what limits us."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """A published problem, as the page tells it."""

    title: str
    source: str
    left_open: str  # what the source does not print, and what we chose
    models: tuple[str, ...]  # names of the URDF files
    method: str  # how their motion is recomputed; empty: none is printed
    # What of our plans needs a word: limits, bounds, what does not agree
    remark: str = ""


PROBLEMS: dict[str, Problem] = {
    "P1": Problem(
        "Planar testbed of the Space Research Centre (Warsaw)",
        "F. L. Basmadji, G. Chmaj, T. Rybus, K. Seweryn, Proc. SPIE 11176, 2019; trajectory of a "
        "TD3 agent in github.com/FatinaBasmadji/space-robot-planar-case (c1cacba)",
        "limits of positions (here half a turn either way), limits of torques (here the largest "
        "of their trajectory)",
        ("cbk_planar",),
        "forward dynamics under their torques, each held for 10 ms; and momentum under their "
        "velocities",
        "Velocities of 0.2 rad/s over 4.99 s leave each joint 1 rad, and its torque alone brings "
        "joint 3 to that velocity in 2.6 s: these are the limit, not the method. In four times the "
        "time the planner's largest turn to the same point is 0.3 deg. "
        "With the heading three joints fix the posture up to the turn itself, and only loops of "
        "the joints, an effect of second order, change it.",
    ),
    "P2a": Problem(
        "Seven joints on 100 kg: sines",
        "H. Jahanshahi, Z. H. Zhu, github.com/HJahanshahi/space-robot-dq 0.3.0 (3b7770d), "
        "examples/generate_paper_figures.py",
        "nothing",
        ("srs_arm",),
        "momentum under the given sines: in their Euler steps, and converged",
    ),
    "P2b": Problem(
        "Seven joints on 100 kg: a straight line",
        "as P2a",
        "the attitude of the end effector at the end: here that of their motion; torques",
        ("srs_arm",),
        "their resolved-rate law, in their Euler steps of 10 ms",
        "Theirs follows a straight line and asks for a position alone; ours asks for the whole "
        "pose at the end, to 0.05 mm and 0.001 deg, and leaves the path free.",
    ),
    "P2c": Problem(
        "Seven joints on 100 kg: a pose on a tumbling target",
        "as P2a",
        "nothing",
        ("srs_arm",),
        "their resolved-rate law, in their Euler steps of 10 ms",
        "One joint is to spare, and the law that is published, of nearly the least joint rates, is "
        "close to the best: of motions with detours, which no check had passed, the least turn was "
        "2.43 deg; of checked plans it is the one below.",
    ),
    "P4": Problem(
        "Basilisk's robotic arm",
        "github.com/AVSLab/basilisk 2.12.1, examples/scenarioRoboticArm.py",
        "limits of positions, velocities and torques; there plots alone are published, the "
        "numbers are Basilisk's at steps of 10 ms",
        ("basilisk_arm",),
        "forward dynamics under springs that follow the profile, without gravity, which does not "
        "turn the system; Basilisk itself on this model, at steps of 10 ms, has 11.746464 deg",
        "The accelerations are those of a profile, no limit of the arm. Within them the splines "
        "need 11 spans to end within 0.01 deg; with the usual 6 there is no plan in 200 starts.",
    ),
    "P5": Problem(
        "Seven joints on 30, 300 and 3000 kg: velocity laws on a circle",
        "github.com/Gonzalez-Annan/reactionless-compliance, v1/models/make_models.py, "
        "v1/src/task.py, schemes.py, v1/data/sweep.csv",
        "the time of point-to-point motions (here 15 s). Of five laws the first and the fifth are"
        " recomputed, in position alone; not the mode with attitude",
        ("compliance_30", "compliance_300", "compliance_3000"),
        "forward dynamics with their servos and motors, their laws at 100 Hz",
        "The axis of joint 7 passes through the end effector and its link weighs little: six "
        "joints are left for six conditions, the place on the circle and a chaser at rest, so that "
        "there is one reactionless motion, and it runs into joint limits. At 300 kg plans within "
        "0.16 mm were found down to 0.15 deg, none at 0.1. Two points of 0.45 m, along +z and -y, "
        "lie 1.16 m from the shoulder, and the arm is 1.09 m long.",
    ),
    "P6": Problem(
        "Planar arm from full stretch: learning agents",
        "github.com/TrustPaddy/space-robot-rl (bba8ff4), SpaceRobot.urdf, KreisbahnSR.m, README",
        "the table of masses is that of the URDF of April 2026; the README has another one",
        ("space_robot_rl",),
        "momentum under one quintic a joint; their agents cannot be recomputed without Simulink",
    ),
    "P8": Problem(
        "SPART's examples",
        "github.com/NPS-SRL/SPART (2018), URDF_models/SC_3DoF.urdf, "
        "examples/ResolvedMotion/ResolvedMotion_Example_Init.m",
        "limits; there are models but no numbers: those here are of an independent chain in numpy"
        " and of MuJoCo's mass matrix",
        ("spart_3dof", "spart_planar"),
        "momentum under one quintic a joint",
    ),
    "P9": Problem(
        "ETS-VII",
        "K. Yoshida, IJRR 22(5), 2003; K. Yoshida, S. Abiko, AIAA GNC 2002; "
        "github.com/vyas-shubham/TraceableRobotModels, ETS-VII/ETSVII.urdf",
        "limits; there is a model but no number: those here are of an independent chain in numpy",
        ("ets_vii",),
        "momentum under one quintic a joint, with the inertias as printed",
        "Links 1 to 3 are impossible as printed: no body has them, and engines refuse them. The "
        "recomputed numbers are of the printed table. Our plan is of the nearest possible one, on"
        " which the same motion turns the base by 1.3457 instead of 1.3443 deg.",
    ),
    "P11": Problem(
        "DEOS and TECSAS (DLR)",
        "github.com/Space-Robotics-Laboratory/SpaceDyn, src/C++/spd/model_sample",
        "start, goal, time, limits: there is no published motion; here one quintic a joint in 30 s",
        ("deos", "tecsas"),
        "",
        "Five links of TECSAS are impossible as printed, the first not even positive; the nearest"
        " possible ones stand in for them.",
    ),
    "P12": Problem(
        "SRMS, the first Canadarm",
        "P. K. Nguyen, P. C. Hughes, Progress in Astronautics and Aeronautics 161, 1994; "
        "github.com/vyas-shubham/TraceableRobotModels, SRMS_Canadarm/SRMS_Canadarm.urdf (2f5c333)",
        "the base (here 10,000 kg, a cube of 3 m), start, goal, time: there is no published "
        "motion; here one quintic a joint in 60 s",
        ("srms",),
        "",
    ),
    "P16": Problem(
        "SpaceRobotEnv, a learning environment",
        "github.com/Tsinghua-Space-Robot-Learning-Group/SpaceRobotEnv, spacerobot_state.xml, "
        "arm_v3.xml, SpaceRobotState.py",
        "limits of positions; no share of success is printed, only what counts as one: 5 cm",
        ("space_robot_env",),
        "",
        "Goals are drawn from the distribution of the environment. It judges at 5 cm; here a goal"
        " counts within 1 mm, of a checked plan within the environment's velocities and torques.",
    ),
}
