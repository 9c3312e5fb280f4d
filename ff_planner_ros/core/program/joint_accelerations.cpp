#include "program/joint_accelerations.hpp"

namespace ff {

RowMajor accelerations_at_points(const Table& positions, const Table& rates, double step) {
  const Eigen::Index last = positions.rows() - 1, inner = positions.rows() - 2;
  const double square = step * step;
  RowMajor found(positions.rows(), positions.cols());
  found.middleRows(1, inner) =
      (2 / square) * (positions.bottomRows(inner) - 2 * positions.middleRows(1, inner) +
                      positions.topRows(inner)) -
      (rates.bottomRows(inner) - rates.topRows(inner)) / (2 * step);
  const auto at_end = [&](Eigen::Index end, Eigen::Index inward) {
    const Eigen::Index near = end + inward, far = near + inward;
    found.row(end) =
        (8 * positions.row(near) + 3.5 * positions.row(far) - 11.5 * positions.row(end)) / square -
        inward * (6 * rates.row(end) + 8 * rates.row(near) + rates.row(far)) / step;
  };
  at_end(0, 1);
  at_end(last, -1);
  return found;
}

void JointAccelerations::differentiate(const JointsAtPoints& of, double step, bool has_duration) {
  by_x = accelerations_at_points(of.positions_by_x, of.rates_by_x, step);
  if (!has_duration) return;
  // Positions count by 1 / T^2, rates by 1 / T.
  const double duration = step * static_cast<double>(of.points() - 1);
  const RowMajor slower = accelerations_at_points(-2 * of.positions, -of.rates, step) / duration;
  for (Eigen::Index j = 0; j < of.joints(); ++j)
    by_x.col((j + 1) * of.variables() - 1) += slower.col(j);
}

}  // namespace ff
