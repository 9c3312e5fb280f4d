#include "motion/joint_path.hpp"

namespace ff {

JointPath::JointPath(const Rows& v, const Rows& dv, double step, double slow, double smoothing)
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

double JointPath::add_length(const Joints& rate, const Rates& by, double step) {
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

void JointPath::add_evenness(const Joints& rate, const Rates& by, double weight) {
  value += weight * (rate.squaredNorm() + slow_ * slow_);
  gradient += 2 * weight * rate.transpose() * by;
}

void JointPath::add_square(const Eigen::Ref<const Eigen::RowVectorXd>& row, double weight) {
  for (int i = 0; i < row.size(); ++i)
    if (row[i] != 0) hessian.row(i).head(i + 1) += weight * row[i] * row.head(i + 1);
}

}  // namespace ff
