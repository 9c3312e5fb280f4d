#include "collision/tumbling_body.hpp"

#include <algorithm>
#include <cmath>

namespace ff {
namespace {

using Row = Eigen::Matrix<double, 1, 4>;

// A quaternion by its series, with its derivatives by time.
struct Turning {
  Row q, rate, change;

  Turning(const TumblingBody::Series& terms, double after)
      : q(terms.row(terms.rows() - 1)), rate(Row::Zero()), change(Row::Zero()) {
    for (auto k = terms.rows() - 2; k >= 0; --k) {
      change = change * after + 2 * rate;
      rate = rate * after + q;
      q = q * after + terms.row(k);
    }
  }
};

}  // namespace

Pose TumblingBody::pose(double time) const {
  const auto number = series_at(time);
  const Row q = Turning(series[number], time - begins[number]).q;
  const Eigen::Quaterniond attitude(q[3], q[0], q[1], q[2]);
  return {position + time * velocity, attitude.normalized().toRotationMatrix()};
}

Vector3 TumblingBody::speed(const Vector3& point, double time) const {
  const auto number = series_at(time);
  const Turning at(series[number], time - begins[number]);
  const Vector3 axis = at.q.head<3>().transpose(), by = at.rate.head<3>().transpose();
  const Vector3 across = axis.cross(point), across_by = by.cross(point);
  // The quaternion's length stays what it is.
  return velocity +
         2 / at.q.squaredNorm() *
             (at.rate[3] * across + at.q[3] * across_by + by.cross(across) + axis.cross(across_by));
}

double TumblingBody::fastest_turn(double until) const {
  constexpr int kParts = 16;  // of a series: within one, the rate changes by its own change at most
  double fastest = 0;
  for (size_t number = 0; number < series.size() && begins[number] <= until; ++number) {
    const bool is_last = number + 1 == series.size();
    const double length =
        ((is_last ? until : std::min(begins[number + 1], until)) - begins[number]);
    // No term of the series is larger than where it ends, nor is what all of them change.
    const double change = Turning(series[number].cwiseAbs(), length).change.norm();
    for (int i = 0; i < kParts; ++i) {
      const Turning at(series[number], i * length / kParts);
      fastest = std::max(fastest, 2 * (at.rate.norm() + change * length / kParts) / at.q.norm());
    }
  }
  return fastest;
}

std::ptrdiff_t TumblingBody::series_at(double time) const {
  return std::upper_bound(begins.begin() + 1, begins.end(), time) - begins.begin() - 1;
}

}  // namespace ff
