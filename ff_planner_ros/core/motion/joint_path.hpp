// The joint path J_L of Eq. (44), how evenly the joints are run, and their derivatives.
//
// With a smoothing s > 0 two terms are added. The first is s T times the integral of the squared
// joint rates: s times the squared joint path if the joints move uniformly along a straight line,
// more otherwise. The second is one more joint at a small constant rate: it rounds the kink that
// J_L has where all joints stop at once and turn back, and where the solver stalls.
#pragma once
#include <algorithm>

#include "kinematics/chain.hpp"

namespace ff {

// Below this joint rate the direction of motion, and with it the gradient, is not defined [rad/s].
constexpr double kStandstill = 1e-9;

class JointPath {
 public:
  double value = 0;
  Eigen::VectorXd gradient;
  RowMajor hessian;  // Gauss-Newton's; positive semidefinite but for rounding

  // v: tangent velocities, a row a point; dv: their derivatives, a block of rows a point.
  // slow: rate of one more joint that turns evenly, or zero; smoothing: weight of the evenness.
  JointPath(const Rows& v, const Rows& dv, double step, double slow, double smoothing);

 private:
  using Rates = Eigen::Block<const Rows, Eigen::Dynamic, Eigen::Dynamic, true>;

  // Adds a step's length, and its curvature along the path; returns that of each joint's rate.
  double add_length(const Joints& rate, const Rates& by, double step);

  void add_evenness(const Joints& rate, const Rates& by, double weight);

  // Adds weight * row^T row to the lower half of the Hessian.
  void add_square(const Eigen::Ref<const Eigen::RowVectorXd>& row, double weight);

  int joints_;
  double slow_;
};

}  // namespace ff
