// The paper's family on a time grid: paths of the end effector.
#pragma once
#include "motion/end_effector_rollout.hpp"
#include "program/path_motion.hpp"

namespace ff {

class EndEffectorPathsOnGrid : public PathsOnGrid {
 public:
  // goal_by_duration: where the duration is one more variable.
  EndEffectorPathsOnGrid(EndEffectorRollout rollout, const std::optional<Vector6>& goal_by_duration)
      : rollout_(std::move(rollout)), goal_by_duration_(goal_by_duration) {}

  const Chain& chain() const override { return rollout_.chain; }
  Eigen::Index points() const override { return rollout_.points; }
  Eigen::Index variables() const override { return kParameters; }

  PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const override;

 private:
  EndEffectorRollout rollout_;
  std::optional<Vector6> goal_by_duration_;
};

}  // namespace ff
