// Where a robot is along a path, with derivatives by the path's variables.
#pragma once
#include <cmath>

#include "kinematics/chain.hpp"

namespace ff {

// Configurations with their derivatives.
struct Path {
  Rows q, dq;  // a row, and a block of 6 + joints rows, a configuration

  auto derivatives(Eigen::Index i) const {
    const Eigen::Index size = q.cols() - 1;
    return dq.middleRows(i * size, size);
  }
};

// When a robot is where a path leads.
struct Times {
  Values at, by_last;  // [s]; derivatives by the last variable: none where they do not depend on it
};

// What is a quarter of the way from one point to another: on the parabola through both and what is
// half-way.
template <typename Value>
typename Value::PlainObject quarter_way(const Value& from, const Value& half_way, const Value& to) {
  return (3 * from + 6 * half_way - to) / 8;
}

// Points of a path and what is between them, in order of time.
class DensePath {
 public:
  RowMajor q;  // a row a configuration

  explicit DensePath(const Path& points) : q(points.q), dq_(points.dq) {}

  // With what is half-way to each point, and quarters: what is at a quarter and at three quarters
  // of every interval, but of the one to the first point.
  DensePath(const Path& points, const Path& half_way, bool has_quarters)
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

  Eigen::Index variables() const { return dq_.cols(); }

  // In the tangent space of q, a column a variable.
  RowMajor derivatives(Eigen::Index i) const { return rows_of(dq_, i, q.cols() - 1); }

 private:
  static RowMajor in_turn(const Rows& first, const Rows& second, Eigen::Index size) {
    RowMajor both(2 * second.rows(), second.cols());
    for (Eigen::Index i = 0; i < second.rows(); i += size) {
      both.middleRows(2 * i, size) = first.middleRows(i, size);
      both.middleRows(2 * i + size, size) = second.middleRows(i, size);
    }
    return both;
  }

  static Eigen::Block<RowMajor, 1, 4> quaternion(RowMajor& of, Eigen::Index i) {
    return of.block<1, 4>(i, 3);
  }

  // Of configuration i, by those that are given, of `size` rows each.
  RowMajor rows_of(const RowMajor& given, Eigen::Index i, Eigen::Index size) const {
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

  RowMajor dq_;  // as it is given
  bool has_quarters_ = false;
};

}  // namespace ff
