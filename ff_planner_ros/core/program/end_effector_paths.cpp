#include "program/end_effector_paths.hpp"

namespace ff {

PathMotion EndEffectorPathsOnGrid::motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const {
  const Eigen::Index size = 6 + chain().joints(), points = this->points(), gaps = points - 1;
  PathMotion found(x, points, size, goal_by_duration_);
  by_x.resize(points, size, rollout_.variables());
  const int singular = rollout_.run(
      Eigen::Map<const Coefficients>(x.data()),
      {from_row(found.q, 0, points), from_row(found.v, 0, points), from_row(found.q, points, gaps),
       from_row(by_x.q, 0, points * size), from_row(by_x.v, 0, points * size),
       from_row(by_x.q, points * size, gaps * size), from_row(found.acceleration, 0, points)});
  if (singular != kRegular)
    found.singular_at = singular / (2.0 * static_cast<double>(gaps)) * rollout_.polynomial.duration;
  return found;
}

}  // namespace ff
