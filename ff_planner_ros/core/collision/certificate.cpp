#include "collision/certificate.hpp"

namespace ff {

double nearest(const ArmPoints& points, const std::vector<int>& starts, const Sphere& sphere,
               double time) {
  double least = std::numeric_limits<double>::infinity();
  const Vector3 center = sphere.center_at(time);
  for (const int k : starts) {
    const Vector3 to_center = center - points.col(k);
    const Vector3 along = points.col(k + 1) - points.col(k);
    const double fraction = nearest_part(to_center, along);
    const double distance = (to_center - fraction * along).norm() - sphere.radius;
    if (std::isnan(distance)) throw std::domain_error("a distance is not a number");
    least = std::min(least, distance);
  }
  return least;
}

Configuration CubicMotion::at(int point, double s) const {
  const Velocity moved = s * cubics.row(3 * point) + s * s * cubics.row(3 * point + 1) +
                         s * s * s * cubics.row(3 * point + 2);
  return q[point].step(moved);
}

double certified_clearance(const CubicMotion& motion, const Values& ways,
                           const std::vector<Sphere>& spheres, double gap, double part) {
  struct Piece {
    int point;
    double begin, end;
    size_t at_begin, at_end;  // rows of `found`
  };
  constexpr double shortest = 1e-12;  // as part of an interval
  constexpr size_t most = 1 << 18;    // pieces: ways that need more are no arm's
  const int intervals = static_cast<int>(ways.size());
  std::vector<ArmPoints> arms;
  for (const Configuration& q : motion.q) arms.push_back(Arm(motion.chain, q).points);
  const std::vector<int> starts = segments(arms);
  // The distance from each sphere at each point, and the least of each.
  RowMajor at_points(intervals + 1, spheres.size());
  for (int i = 0; i <= intervals; ++i)
    for (size_t k = 0; k < spheres.size(); ++k)
      at_points(i, k) = nearest(arms[i], starts, spheres[k], motion.times[i]);
  double lowest = at_points.minCoeff(), certified = lowest;
  const auto way = [&](int point, const Sphere& sphere) {
    const double seconds = motion.times[point + 1] - motion.times[point];
    return ways[point] + seconds * sphere.highest_speed;
  };
  // What no step can bring nearer than the nearest point need not be looked at again.
  std::vector<int> reachable;
  for (size_t k = 0; k < spheres.size(); ++k) {
    double longest = 0;
    for (int i = 0; i < intervals; ++i) longest = std::max(longest, way(i, spheres[k]));
    if (at_points.col(k).minCoeff() <= lowest + longest) reachable.push_back(static_cast<int>(k));
  }
  std::vector<double> found;  // distances from each of these, a row wherever the arm was looked at
  for (int i = 0; i <= intervals; ++i)
    for (const int k : reachable) found.push_back(at_points(i, k));
  std::vector<Piece> pieces;
  for (int i = 0; i < intervals; ++i) pieces.push_back({i, 0, 1, size_t(i), size_t(i) + 1});
  for (size_t looked = 0;; looked += pieces.size()) {
    std::vector<Piece> open, halves;
    for (const Piece& piece : pieces) {
      const double length = piece.end - piece.begin;
      double bound = std::numeric_limits<double>::infinity();
      for (size_t n = 0; n < reachable.size(); ++n) {
        const double moved = way(piece.point, spheres[reachable[n]]) * length;
        const double both = found[piece.at_begin * reachable.size() + n] +
                            found[piece.at_end * reachable.size() + n];
        bound = std::min(bound, (both - moved) / 2);
      }
      if (bound < lowest - std::max(gap, part * lowest) && length > shortest && looked < most)
        open.push_back(piece);
      else
        certified = std::min(certified, bound);
    }
    if (open.empty()) return certified;
    for (const auto& [point, begin, end, at_begin, at_end] : open) {
      const double middle = (begin + end) / 2;
      const double time =
          motion.times[point] + middle * (motion.times[point + 1] - motion.times[point]);
      const Arm arm(motion.chain, motion.at(point, middle));
      const size_t there = found.size() / reachable.size();
      for (const int k : reachable) {
        found.push_back(nearest(arm.points, starts, spheres[k], time));
        lowest = std::min(lowest, found.back());
      }
      halves.push_back({point, begin, middle, at_begin, there});
      halves.push_back({point, middle, end, there, at_end});
    }
    pieces = halves;
  }
}

}  // namespace ff
