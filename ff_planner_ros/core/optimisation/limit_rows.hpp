// Rows of the search for limits on both sides: of quantities at the points of a path, of joints at
// their extremes in between, and of joints that stop after the last point.
#pragma once
#include <array>
#include <vector>

#include "kinematics/chain.hpp"

namespace ff {

// A row a point; of derivatives, those of one quantity after those of another.
using Table = Eigen::Ref<const RowMajor>;

// Joints at the points of a path.
struct JointsAtPoints {
  Table positions, rates, positions_by_x, rates_by_x;

  Eigen::Index points() const { return positions.rows(); }
  Eigen::Index joints() const { return positions.cols(); }
  Eigen::Index variables() const { return positions_by_x.cols() / joints(); }
};

// A joint's extreme position or rate between two points, on the cubic through both positions and
// rates. Its value does not change with its time to first order: its derivative is that at a fixed
// part of the interval.
struct Extreme {
  // Of the position at the interval's begin and end, then of the rate.
  using Weights = std::array<double, 4>;

  Eigen::Index interval, joint;
  Weights weights, weights_by_step;
  bool is_second = false;  // of that joint in that interval

  double sum(const Weights& w, const JointsAtPoints& of) const;
  double value(const JointsAtPoints& of) const { return sum(weights, of); }
  // has_duration: is the last variable the duration?
  Eigen::RowVectorXd by_x(const JointsAtPoints& of, bool has_duration) const;
};

// Where joints turn round, by root, interval and joint. h: time from point to point [s].
std::vector<Extreme> turns(const JointsAtPoints& of, double h);

// Where joints are fastest, by interval and joint.
std::vector<Extreme> peak_rates(const JointsAtPoints& of, double h);

// What is left to the limits, and its derivatives, where that is below `interest`.
class LimitRows {
 public:
  std::vector<double> values, jacobian;  // not to become negative; a row a value
  std::vector<long long> names;

  LimitRows(const Values& lower, const Values& upper, const Values& interest)
      : lower_(lower), upper_(upper), interest_(interest) {}

  // Of quantities at points, named by side, point and quantity.
  void add_points(const Table& of, const Table& by_x);

  // Of joints between the points; the names are below zero, where those at points are above.
  void add_extremes(const std::vector<Extreme>& extremes, const JointsAtPoints& of,
                    bool has_duration);

  // Of joints that stop after the last point by a jerk. Without acceleration they do so after
  // t = sqrt(2 v / jerk), further by v t - jerk t^3 / 6. By the time t this does not change, so
  // that its derivative by v is t. The names are numbers by side, the lower one first, and joint.
  void add_stops(const JointsAtPoints& of, double jerk);

 private:
  enum Side { kUpper, kLower };

  double left(Side side, Eigen::Index j, double value) const;

  // NaN is near: it is not overlooked, but refused.
  bool is_near(double room, Eigen::Index j) const { return !(room >= interest_[j]); }

  template <typename Gradient>
  void add(Side side, double room, const Gradient& gradient, Eigen::Index name) {
    values.push_back(room);
    names.push_back(name);
    const size_t begin = jacobian.size();
    jacobian.resize(begin + gradient.size());
    Eigen::Map<Eigen::RowVectorXd>(jacobian.data() + begin, gradient.size()) =
        (side == kUpper ? -1.0 : 1.0) * gradient;
  }

  Values lower_, upper_, interest_;
};

}  // namespace ff
