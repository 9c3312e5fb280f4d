#include "program/path_requirement.hpp"

namespace ff {

const BodiesAlong& LookedAt::bodies(const Bodies& of, bool quarter_way) const {
  const std::pair asked(&of, quarter_way);
  const auto known = bodies_.find(asked);
  if (known != bodies_.end()) return known->second;
  const Eigen::Index gaps = motion.points() - 1;
  DensePath path(from(1, gaps), from(motion.points(), gaps), quarter_way);
  return bodies_.try_emplace(asked, chain, of, std::move(path)).first->second;
}

Path LookedAt::from(Eigen::Index first, Eigen::Index count) const {
  const Eigen::Index size = motion.v.cols();
  return {{motion.q.data() + first * motion.q.cols(), count, motion.q.cols()},
          {by_x.q.data() + first * size * motion.variables(), count * size, motion.variables()}};
}

void PathRequirement::require(bool fits, const char* message) {
  if (!fits) throw std::invalid_argument(message);
}

Eigen::VectorXd eased(const Eigen::VectorXd& limits, const Eigen::VectorXd& at_start,
                      const Eigen::VectorXd& excess) {
  return (at_start.array() <= (limits + excess).array()).select(limits.cwiseMax(at_start), limits);
}

Eigen::VectorXd kept(const Eigen::VectorXd& limits, const Eigen::VectorXd& at_start,
                     const Eigen::VectorXd& margin) {
  return limits - (limits - at_start).cwiseMax(0).cwiseMin(margin);
}

ConstraintRows taken(LimitRows& rows) {
  return {std::move(rows.values), std::move(rows.jacobian), std::move(rows.names)};
}

}  // namespace ff
