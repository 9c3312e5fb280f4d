#include "program/path_motion.hpp"

namespace ff {

void PathDerivatives::resize(Eigen::Index points, Eigen::Index size, Eigen::Index variables) {
  q.resize((2 * points - 1) * size, variables);
  v.resize(points * size, variables);
}

JointsAtPoints joints_of(const PathMotion& motion, const PathDerivatives& by_x,
                         Eigen::Index first) {
  const Eigen::Index size = motion.v.cols(), joints = size - 6, count = motion.points() - first;
  const Eigen::Index each = size * motion.variables(), of_joints = joints * motion.variables();
  // Of derivatives, a row a point.
  const Rows by_q(by_x.q.data() + first * each, count, each);
  const Rows by_v(by_x.v.data() + first * each, count, each);
  return {motion.q.middleRows(first, count).rightCols(joints),
          motion.v.bottomRows(count).rightCols(joints), by_q.rightCols(of_joints),
          by_v.rightCols(of_joints)};
}

RowsToFill from_row(RowMajor& of, Eigen::Index first, Eigen::Index count) {
  return {of.data() + first * of.cols(), count, of.cols()};
}

}  // namespace ff
