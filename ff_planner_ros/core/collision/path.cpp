#include "collision/path.hpp"

namespace ff {

DensePath::DensePath(const Path& points, const Path& half_way, bool has_quarters)
    : q(in_turn(half_way.q, points.q, 1)),
      dq_(in_turn(half_way.dq, points.dq, points.q.cols() - 1)),
      has_quarters_(has_quarters) {
  if (!has_quarters) return;
  RowMajor given = q;
  // Quaternions of one sign: what lies between two is between their entries.
  for (Eigen::Index i = 1; i < given.rows(); ++i)
    if (quaternion(given, i - 1).dot(quaternion(given, i)) < 0) quaternion(given, i) *= -1;
  q.resize(2 * given.rows() - 2, given.cols());
  for (Eigen::Index i = 0; i < q.rows(); ++i) {
    q.row(i) = rows_of(given, i, 1);
    auto attitude = quaternion(q, i);
    double square = 0;  // Eigen's own sum has another order on another machine
    for (const double part : attitude) square += part * part;
    attitude /= std::sqrt(square);
  }
}

RowMajor DensePath::in_turn(const Rows& first, const Rows& second, Eigen::Index size) {
  RowMajor both(2 * second.rows(), second.cols());
  for (Eigen::Index i = 0; i < second.rows(); i += size) {
    both.middleRows(2 * i, size) = first.middleRows(i, size);
    both.middleRows(2 * i + size, size) = second.middleRows(i, size);
  }
  return both;
}

Eigen::Block<RowMajor, 1, 4> DensePath::quaternion(RowMajor& of, Eigen::Index i) {
  return of.block<1, 4>(i, 3);
}

RowMajor DensePath::rows_of(const RowMajor& given, Eigen::Index i, Eigen::Index size) const {
  const auto at = [&](Eigen::Index number) { return given.middleRows(number * size, size); };
  if (!has_quarters_ || i < 2) return at(i);
  const Eigen::Index middle = (i + 2) / 4 * 2, begin = middle - 1, end = middle + 1;
  switch ((i + 2) % 4) {
    case 0:
      return quarter_way(at(begin), at(middle), at(end));
    case 1:
      return at(middle);
    case 2:
      return quarter_way(at(end), at(middle), at(begin));
    default:
      return at(end);
  }
}

}  // namespace ff
