// The joint path J_L of Eq. (44), how evenly the joints are run, and their derivatives.
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
  RowMajor hessian;  // Gauss-Newton's; positive semidefinite

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
      // The rectangle rule takes all points but the last.
      if (i < intervals) add_length(rate, by, step);
      // T times the integral of the squared rates, by the trapezoidal rule.
      const double weight = smoothing * duration * (i % intervals == 0 ? step / 2 : step);
      if (smoothing > 0) add_evenness(rate, by, weight);
    }
    hessian.triangularView<Eigen::StrictlyUpper>() = hessian.transpose();
  }

 private:
  using Rates = Eigen::Block<const Rows, Eigen::Dynamic, Eigen::Dynamic, true>;

  void add_length(const Joints& rate, const Rates& by, double step) {
    const double norm = std::sqrt(rate.squaredNorm() + slow_ * slow_);
    const double speed = std::max(norm, kStandstill);
    const Eigen::RowVectorXd along = rate.transpose() / speed * by;
    value += norm * step;
    gradient += step * along;
    // Across the path: a row a joint, then that of the slow joint.
    for (int j = 0; j < joints_; ++j) add_square(by.row(j) - rate[j] / speed * along, step / speed);
    if (slow_ > 0) add_square(slow_ / speed * along, step / speed);
  }

  void add_evenness(const Joints& rate, const Rates& by, double weight) {
    value += weight * (rate.squaredNorm() + slow_ * slow_);
    gradient += 2 * weight * rate.transpose() * by;
    for (int j = 0; j < joints_; ++j) add_square(by.row(j), 2 * weight);
  }

  // Adds weight * row^T row to the lower half of the Hessian.
  void add_square(const Eigen::RowVectorXd& row, double weight) {
    for (int i = 0; i < row.size(); ++i)
      if (row[i] != 0) hessian.row(i).head(i + 1) += weight * row[i] * row.head(i + 1);
  }

  int joints_;
  double slow_;
};

}  // namespace ff
