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

  // Points with what is half-way to each of them, and quarters: what is at a quarter and at three
  // quarters of every interval, but of the one to the first point.
  DensePath(const Path& points, const Path& half_way, bool has_quarters);

  Eigen::Index variables() const { return dq_.cols(); }

  // In the tangent space of q, a column a variable.
  RowMajor derivatives(Eigen::Index i) const { return rows_of(dq_, i, q.cols() - 1); }

 private:
  static RowMajor in_turn(const Rows& first, const Rows& second, Eigen::Index size);

  static Eigen::Block<RowMajor, 1, 4> quaternion(RowMajor& of, Eigen::Index i);

  // Of configuration i, by those that are given, of `size` rows each.
  RowMajor rows_of(const RowMajor& given, Eigen::Index i, Eigen::Index size) const;

  RowMajor dq_;  // as it is given
  bool has_quarters_;
};

}  // namespace ff
