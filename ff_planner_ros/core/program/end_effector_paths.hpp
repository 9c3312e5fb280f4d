// The paper's family on a time grid: paths of the end effector.
#pragma once
#include "motion/end_effector_rollout.hpp"
#include "program/path_motion.hpp"

namespace ff {

class EndEffectorPathsOnGrid : public PathsOnGrid {
 public:
  EndEffectorPathsOnGrid(const Chain& chain, const Configuration& start, const Vector6& momentum,
                         const EndEffectorPolynomial& path, const NullSpaceFade& null_space,
                         int points, double damping, const std::optional<Vector6>& goal_by_duration)
      : chain_(chain),
        start_(start),
        momentum_(momentum),
        path_(path),
        null_space_(null_space),
        points_(points),
        damping_(damping),
        goal_by_duration_(goal_by_duration) {}

  const Chain& chain() const override { return chain_; }
  Eigen::Index points() const override { return points_; }
  Eigen::Index variables() const override { return kParameters; }

  PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const override {
    return goal_by_duration_ ? motion_of<kParameters + 1>(x, by_x)
                             : motion_of<kParameters>(x, by_x);
  }

 private:
  template <int columns>
  PathMotion motion_of(const Eigen::VectorXd& x, PathDerivatives& by_x) const {
    const Eigen::Index size = 6 + chain_.joints(), points = points_, gaps = points - 1;
    PathMotion found(x, points, size, goal_by_duration_);
    by_x.resize(points, size, columns);
    const EndEffectorRollout<columns> rollout(chain_, momentum_, path_, null_space_,
                                              Eigen::Map<const Coefficients>(x.data()), points_,
                                              damping_);
    const int singular = rollout.run(
        start_, {from_row(found.q, 0, points), from_row(found.v, 0, points),
                 from_row(found.q, points, gaps), from_row(by_x.q, 0, points * size),
                 from_row(by_x.v, 0, points * size), from_row(by_x.q, points * size, gaps * size),
                 from_row(found.acceleration, 0, points)});
    if (singular != kRegular)
      found.singular_at = singular / (2.0 * static_cast<double>(gaps)) * path_.duration;
    return found;
  }

  Chain chain_;
  Configuration start_;
  Vector6 momentum_;
  EndEffectorPolynomial path_;
  NullSpaceFade null_space_;
  int points_;
  double damping_;
  std::optional<Vector6> goal_by_duration_;  // where the duration is one more variable
};

}  // namespace ff
