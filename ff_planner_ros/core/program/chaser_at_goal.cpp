#include "program/chaser_at_goal.hpp"

#include "kinematics/rotation.hpp"

namespace ff {

ConstraintRows ChaserAtGoal::rows(const LookedAt& at) const {
  const Eigen::Index last = at.motion.points() - 1, size = at.motion.v.cols();
  const Eigen::Quaterniond attitude = Configuration::read(at.motion.q.row(last)).attitude;
  const Eigen::Quaterniond off = Eigen::Quaterniond(wanted).conjugate() * attitude;
  const Vector3 turn = turn_of_quaternion(off.normalized().coeffs());
  const auto turned = at.by_x.q.middleRows(last * size + 3, 3);
  const double angle = turn.norm();
  const double measure = angle < knee ? angle * angle / (2 * knee) + knee / 2 : angle;
  ConstraintRows found;
  const Vector3 by_turn = -turn / std::max(angle, knee);
  found.add(limit - measure, 0, by_turn.transpose() * turned);
  const RowMajor by_x = turn_of_derivative(turn) * turned;
  for (int k = 0; k < 3; ++k) {
    found.add(limit - turn[k], 1 + 2 * k, -by_x.row(k));
    found.add(limit + turn[k], 2 + 2 * k, by_x.row(k));
  }
  return found;
}

}  // namespace ff
