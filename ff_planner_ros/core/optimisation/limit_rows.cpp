#include "optimisation/limit_rows.hpp"

namespace ff {

double Extreme::sum(const Weights& w, const JointsAtPoints& of) const {
  const Eigen::Index i = interval, j = joint;
  return w[0] * of.positions(i, j) + w[1] * of.positions(i + 1, j) + w[2] * of.rates(i, j) +
         w[3] * of.rates(i + 1, j);
}

Eigen::RowVectorXd Extreme::by_x(const JointsAtPoints& of, bool has_duration) const {
  const Eigen::Index size = of.variables();
  const auto at = [&](const Table& rows, Eigen::Index point) {
    return rows.row(point).segment(joint * size, size);
  };
  const Eigen::Index i = interval;
  Eigen::RowVectorXd found =
      weights[0] * at(of.positions_by_x, i) + weights[1] * at(of.positions_by_x, i + 1) +
      weights[2] * at(of.rates_by_x, i) + weights[3] * at(of.rates_by_x, i + 1);
  if (has_duration)
    found[size - 1] += sum(weights_by_step, of) / static_cast<double>(of.points() - 1);
  return found;
}

std::vector<Extreme> turns(const JointsAtPoints& of, double h) {
  std::array<std::vector<Extreme>, 2> found;
  for (Eigen::Index i = 0; i + 1 < of.points(); ++i)
    for (Eigen::Index j = 0; j < of.joints(); ++j) {
      // The rate along the cubic, times the step: a s^2 + b s + c with s from 0 to 1.
      const double c = h * of.rates(i, j), end = of.rates(i + 1, j);
      const double way = of.positions(i + 1, j) - of.positions(i, j);
      const double a = 3 * (c + h * end) - 6 * way, b = 6 * way - 4 * c - 2 * h * end;
      const double square = b * b - 4 * a * c;
      if (!(square > 0)) continue;
      const double q = -(b + std::copysign(std::sqrt(square), b)) / 2;
      const double roots[] = {q / a, c / q};  // infinite or NaN where a or q is zero
      bool is_second = false;
      for (int root = 0; root < 2; ++root) {
        const double s = roots[root];
        if (!(s > 0 && s < 1)) continue;
        const double of_end = s * s * (3 - 2 * s), back = (1 - s) * (1 - s);
        found[root].push_back({i,
                               j,
                               {1 - of_end, of_end, h * s * back, h * (s * s) * (s - 1)},
                               {0, 0, s * back, s * s * (s - 1)},
                               is_second});
        is_second = true;
      }
    }
  found[0].insert(found[0].end(), found[1].begin(), found[1].end());
  return found[0];
}

std::vector<Extreme> peak_rates(const JointsAtPoints& of, double h) {
  std::vector<Extreme> found;
  for (Eigen::Index i = 0; i + 1 < of.points(); ++i)
    for (Eigen::Index j = 0; j < of.joints(); ++j) {
      const double begin = of.rates(i, j), end = of.rates(i + 1, j);
      const double way = (of.positions(i + 1, j) - of.positions(i, j)) / h;
      // The rate's slope, times the step: it falls to zero at s.
      const double curvature = 6 * (begin + end - 2 * way), slope = 6 * way - 4 * begin - 2 * end;
      const double s = -slope / curvature;
      if (!(s > 0 && s < 1)) continue;
      const double of_way = 6 * s * (1 - s) / h;
      found.push_back({i,
                       j,
                       {-of_way, of_way, (1 - s) * (1 - 3 * s), s * (3 * s - 2)},
                       {of_way / h, -of_way / h, 0, 0}});
    }
  return found;
}

void LimitRows::add_points(const Table& of, const Table& by_x) {
  const Eigen::Index size = of.cols() == 0 ? 0 : by_x.cols() / of.cols();
  for (const Side side : {kUpper, kLower})
    for (Eigen::Index i = 0; i < of.rows(); ++i)
      for (Eigen::Index j = 0; j < of.cols(); ++j)
        if (const double room = left(side, j, of(i, j)); is_near(room, j))
          add(side, room, by_x.row(i).segment(j * size, size),
              (side * of.rows() + i) * of.cols() + j);
}

void LimitRows::add_extremes(const std::vector<Extreme>& extremes, const JointsAtPoints& of,
                             bool has_duration) {
  for (const Side side : {kUpper, kLower})
    for (const Extreme& at : extremes)
      if (const double room = left(side, at.joint, at.value(of)); is_near(room, at.joint))
        add(side, room, at.by_x(of, has_duration),
            -1 -
                (((2 * at.is_second + side) * of.points() + at.interval) * of.joints() + at.joint));
}

void LimitRows::add_stops(const JointsAtPoints& of, double jerk) {
  const Eigen::Index last = of.points() - 1, size = of.variables();
  for (Eigen::Index j = 0; j < of.joints(); ++j) {
    const double rate = of.rates(last, j), t = std::sqrt(2 * std::abs(rate) / jerk);
    const double way = std::abs(rate) * t - jerk * (t * t * t) / 6;
    const Side side = rate > 0 ? kUpper : kLower;
    if (const double room = left(side, j, of.positions(last, j)) - way; is_near(room, j))
      add(side, room,
          of.positions_by_x.row(last).segment(j * size, size) +
              t * of.rates_by_x.row(last).segment(j * size, size),
          (side == kUpper ? of.joints() : 0) + j);
  }
}

double LimitRows::left(Side side, Eigen::Index j, double value) const {
  return side == kUpper ? upper_[j] - value : value - lower_[j];
}

}  // namespace ff
