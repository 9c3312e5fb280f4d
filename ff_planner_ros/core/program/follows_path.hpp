// The end effector beside a path that is given in time.
#pragma once
#include "kinematics/arm.hpp"
#include "program/path_requirement.hpp"

namespace ff {

// Each component of the end effector's error, inertial axes, within a bound either way.
struct FollowsPath : PathRequirement {
  RowMajor positions;  // of the path at the times of `LookedAt::path`, a row each [m]
  RowMajor rotations;  // to inertial axes, three rows a time; none: the orientation is free
  Vector6 counts;      // one of each component that counts: position, then orientation
  double position, orientation;  // the bounds of a component [m, rad]

  void require_fits(const Tree&, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;

 private:
  bool turns() const { return rotations.rows() > 0; }
};

}  // namespace ff
