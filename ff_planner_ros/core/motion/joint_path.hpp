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
  JointPath(const Rows& v, const Rows& dv, double step, double slow, double smoothing)
      : gradient(Eigen::VectorXd::Zero(dv.cols())),
        hessian(RowMajor::Zero(dv.cols(), dv.cols())),
        joints_(static_cast<int>(v.cols()) - 6),
        slow_(slow) {
    const int intervals = static_cast<int>(v.rows()) - 1;
    const double duration = intervals * step;
    for (int i = 0; i <= intervals; ++i) {
      const Joints rate = v.row(i).tail(joints_);
      const Rates by = dv.middleRows(i * v.cols() + 6, joints_);
      // T times the integral of the squared rates, by the trapezoidal rule.
      const double weight = smoothing * duration * (i % intervals == 0 ? step / 2 : step);
      if (smoothing > 0) add_evenness(rate, by, weight);
      // The rectangle rule takes all points but the last.
      double curvature = 2 * weight;
      if (i < intervals) curvature += add_length(rate, by, step);
      for (int j = 0; j < joints_; ++j) add_square(by.row(j), curvature);
    }
    hessian.triangularView<Eigen::StrictlyUpper>() = hessian.transpose();
  }

 private:
  using Rates = Eigen::Block<const Rows, Eigen::Dynamic, Eigen::Dynamic, true>;

  // Adds a step's length, and its curvature along the path; returns that of each joint's rate.
  double add_length(const Joints& rate, const Rates& by, double step) {
    const double norm = std::sqrt(rate.squaredNorm() + slow_ * slow_);
    const double speed = std::max(norm, kStandstill);
    const Eigen::RowVectorXd along = rate.transpose() / speed * by;
    value += norm * step;
    gradient += step * along;
    // Only rates across the path curve its length. The squares of by - rate / speed * along, a row
    // a joint and one of the slow joint, are those of by less this one.
    const double part = norm / speed;
    add_square(along, step / speed * (part * part - 2));
    return step / speed;
  }

  void add_evenness(const Joints& rate, const Rates& by, double weight) {
    value += weight * (rate.squaredNorm() + slow_ * slow_);
    gradient += 2 * weight * rate.transpose() * by;
  }

  // Adds weight * row^T row to the lower half of the Hessian.
  void add_square(const Eigen::Ref<const Eigen::RowVectorXd>& row, double weight) {
    for (int i = 0; i < row.size(); ++i)
      if (row[i] != 0) hessian.row(i).head(i + 1) += weight * row[i] * row.head(i + 1);
  }

  int joints_;
  double slow_;
};

}  // namespace ff
