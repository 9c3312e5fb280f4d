// What a motion misses of its goal: pose, twist and acceleration of the end effector, or a part.
#pragma once
#include "kinematics/end_effector_motion.hpp"
#include "kinematics/rotation.hpp"

namespace ff {

enum class Orientation { kFixed, kAboutAxis, kFree };
using Directions = std::vector<Vector3>;

struct Target {
  Vector3 position;
  Matrix3 rotation;  // to inertial axes
  Vector6 twist, acceleration;
  Orientation orientation;
  Vector3 free_axis;  // of the end effector, about which it may turn
  Directions across;  // its axes across that one
};

// How a target changes with a variable: its place and attitude as a twist, what is wanted there,
// and the duration.
struct TargetChange {
  Vector6 way = Vector6::Zero(), twist = Vector6::Zero(), acceleration = Vector6::Zero();
  double duration = 0;
};

// A vector, and its derivative along some direction.
struct Changing {
  Vector3 value, change;
};

// Values, and their derivatives along some direction.
struct Conditions {
  std::vector<double> values, changes;

  // Appends the parts of a vector along some axes.
  void add(const Directions& axes, double unit, const Changing& vector, double unit_change = 0);
};

// The turn that the free axis misses the target's by, in axes of the end effector [rad].
Changing axis_error(const Target& target, const Matrix3& rotation, const Vector3& turn);

// Pose first, then twist and acceleration: lengths [m] and angles [rad], those of the last two
// being the way that they make in a quarter of the duration. `by` and `of_target`: the direction of
// the derivatives.
Conditions end_conditions(const Target& target, const EndEffectorMotion& tip,
                          const EndEffectorChange& by, const TargetChange& of_target,
                          double duration, bool planar);

}  // namespace ff
