// Limits of what motions take of joints, grasps and wheels: accelerations, torques and momenta.
#pragma once
#include "kinematics/inverse_dynamics.hpp"
#include "program/path_requirement.hpp"
#include "program/wheel_loads.hpp"

namespace ff {

// Quantities at all points as parts of their limits, with their derivatives: a row a point each.
struct Parts {
  RowMajor values, by_x;

  // parts: what one unit of each load is; zero: it has no limit.
  Parts(const RowMajor& loads, const RowMajor& loads_by_x, const Eigen::VectorXd& parts);

  // A parabola through three points exceeds the largest of them, between the outer ones, by an
  // eighth of its second difference at most.
  void raise_at_peaks();
};

// Loads with limits either way; the search keeps `most` of each.
struct LoadsWithin : PathRequirement {
  double margin, interest;  // fractions of the limits

 protected:
  // At all points but the first.
  ConstraintRows within(const Parts& parts, const Eigen::VectorXd& most) const;
};

struct AccelerationsWithin : LoadsWithin {
  Eigen::VectorXd parts;  // of its limit that a unit of each joint is; zero: it has none
  bool between;           // points are so dense that what is between them is told by parabolas

  void require_fits(const Tree& tree, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// Loads that inverse dynamics tells.
struct DynamicLoadsWithin : LoadsWithin {
  Base base;

 protected:
  // Calls `look` with each point but the first and the dynamics there.
  template <typename Look>
  void each_point(const LookedAt& at, const RowMajor& accelerations, const Look& look) const {
    const JointsAtPoints joints = at.joints();
    for (Eigen::Index i = 1; i < joints.points(); ++i) {
      const Posture posture(at.chain, joints.positions.row(i));
      const Vector6 twist = at.motion.v.row(i).head<6>();
      look(i, InverseDynamics(posture, base, twist, joints.rates.row(i), accelerations.row(i)));
    }
  }
  // Derivatives of forces at a point by x.
  static RowMajor by_x(const InverseDynamics::Derivatives& by, const LookedAt& at,
                       const JointAccelerations& moved, Eigen::Index point);
};

struct TorquesWithin : DynamicLoadsWithin {
  Eigen::VectorXd parts;  // as of `AccelerationsWithin`

  void require_fits(const Tree& tree, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// Force and torque through the grasp of a payload.
struct GraspWrenchWithin : DynamicLoadsWithin {
  int link;               // the body that holds the payload
  Vector3 position;       // of the grasp, in the frame of that
  Matrix3 rotation;       // likewise
  double mass;            // of the payload [kg]
  Vector3 center;         // its centre of mass, in the frame of the grasp
  Matrix3 inertia;        // about that, likewise
  Eigen::VectorXd parts;  // of their limits that a unit of force and of torque is; zero: none

  void require_fits(const Tree& tree, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;

 private:
  HeldBody held(const Chain& chain, const Joints& positions) const;
};

// Momentum and torque of wheels that hold the chaser's attitude.
struct WheelsWithin : LoadsWithin {
  Wheels wheels;
  Eigen::VectorXd momenta, torques;  // parts of its limits that a unit is of each wheel
  double excess;                     // fraction of the limits
  bool between;                      // as of `AccelerationsWithin`

  void require_fits(const Tree&, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;

 private:
  // Names of torques are above those of momenta.
  static constexpr long long kTorques = 1 << 30;
};

}  // namespace ff
