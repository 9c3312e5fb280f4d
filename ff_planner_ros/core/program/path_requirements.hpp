// Limits of positions, rates, attitudes and singular values along a path.
#pragma once
#include "kinematics/chaser_euler.hpp"
#include "kinematics/rotation.hpp"
#include "kinematics/singular_values.hpp"
#include "program/path_requirement.hpp"

namespace ff {

// Joint positions at points and where joints turn round, and where joints come to rest that stop
// after the last point.
struct PositionsWithin : PathRequirement {
  Eigen::VectorXd lower, upper;
  double excess, margin, interest;  // [rad, m]
  double stop_interest, jerk;

  void require_fits(const Tree& tree, Eigen::Index) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// Joint rates at points and where they peak.
struct RatesWithin : PathRequirement {
  Eigen::VectorXd limits;           // [rad/s, m/s]
  double excess, margin, interest;  // fractions of the limits; the last: of what is far from them

  void require_fits(const Tree& tree, Eigen::Index) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// The chaser's Euler angles at points and half-way.
struct AttitudeWithin : PathRequirement {
  Matrix3 chaser_to_base;
  double limit, interest;  // [rad]

  ConstraintRows rows(const LookedAt& at) const override;
};

// The angle of the chaser's rotation since the first point, at points and half-way: below the knee
// its parabola, which has a derivative where the chaser has not rotated.
struct RotationWithin : PathRequirement {
  double limit, knee, interest;  // [rad]

  ConstraintRows rows(const LookedAt& at) const override;
};

// The smallest singular value of the generalised Jacobian at all points but the first.
struct SingularValueAbove : PathRequirement {
  Vector6 movable;          // rows of the base that give way: one, the others: zero
  double margin, interest;  // the latter a multiple of the margin

  ConstraintRows rows(const LookedAt& at) const override;
};

}  // namespace ff
