// The chaser's attitude at the goal, along a path.
#pragma once
#include "program/path_requirement.hpp"

namespace ff {

// The base is turned by at most an angle from a wanted attitude at the last point. The rows are
// that angle, below the knee its parabola, and its components both ways: these lead a path that is
// far off to all three at once.
struct ChaserAtGoal : PathRequirement {
  Matrix3 wanted;      // of the base's axes, to inertial axes
  double limit, knee;  // [rad]

  ConstraintRows rows(const LookedAt& at) const override;
};

}  // namespace ff
