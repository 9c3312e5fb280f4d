// The objectives of Eqs. (44) and (45) of a path on a time grid.
#pragma once
#include "kinematics/chaser_euler.hpp"
#include "motion/joint_path.hpp"
#include "program/evaluated_path.hpp"
#include "program/wheel_loads.hpp"

namespace ff {

struct PathObjective {
  double joint_path;       // weight
  double slow, smoothing;  // see `JointPath`
  Eigen::VectorXd shares;  // of each velocity in the joint path; empty: all are one
  double attitude;         // weight
  Matrix3 chaser_to_base;  // of the chaser's axes
  // p of the p-norm that stands for the largest Euler angle; zero: none does.
  double attitude_norm;
  double wheel_momentum;  // weight; the wheels hold the attitude
  std::optional<Wheels> wheels;

  // step: time between two points [s].
  Terms terms(const Chain& chain, const PathMotion& motion, const PathDerivatives& by_x,
              double step) const;

 private:
  void add_joint_path(const PathMotion& motion, const PathDerivatives& by_x, double step,
                      Terms& to) const;

  void add_attitude(const PathMotion& motion, const PathDerivatives& of_x, Terms& to) const;

  // The largest modulus of some values.
  static void add_largest(const Values& values, const Rows& by_x, Terms& to);

  // (mean |values|^p)^(1/p), which is smooth where its limit for large p, the largest modulus, has
  // kinks. Its Gauss-Newton Hessian is exact if the values are linear in x, and positive
  // semidefinite because a norm is convex.
  static void add_power_mean(const Eigen::VectorXd& values, const RowMajor& by_x, double p,
                             Terms& to);
};

}  // namespace ff
