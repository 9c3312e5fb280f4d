#include "collision/clearance.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

ArmMotion::ArmMotion(const Chain& chain, const Path& path) : path_(path) {
  arms_.reserve(path.q.rows());
  points.reserve(2 * path.q.rows());
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    Deadline::require();
    arms_.emplace_back(chain, Configuration::read(path.q.row(i)));
    points.push_back(arms_.back().points);
  }
}

void ArmMotion::add_quarter_way() {
  const int gaps = static_cast<int>(arms_.size()) / 2;
  for (const bool late : {false, true})
    for (int i = 0; i + 1 < gaps; ++i) {
      const Parabola at{late ? i + 1 : i, gaps + i + 1, late ? i : i + 1};
      points.push_back(quarter_way(points[at.near], points[at.middle], points[at.far]));
      between_.push_back(at);
    }
}

void ArmMotion::add_gradient(size_t at, int k, double fraction, const Vector3& direction,
                             Gradient to) const {
  const auto add = [&](double weight, int configuration) {
    const Velocity by_q = arms_[configuration].gradient(k, fraction, weight * direction);
    to.noalias() += by_q.transpose() * path_.derivatives(configuration).topRows(by_q.size());
  };
  if (at < arms_.size()) return add(1, static_cast<int>(at));
  const Parabola& by = between_[at - arms_.size()];
  add(3. / 8, by.near);
  add(6. / 8, by.middle);
  add(-1. / 8, by.far);
}

std::vector<int> segments(const std::vector<ArmPoints>& points) {
  std::vector<int> starts;
  for (int k = 0; k + 1 < points[0].cols(); ++k)
    if (std::any_of(points.begin(), points.end(), [k](const ArmPoints& at) {
          return (at.col(k + 1) - at.col(k)).norm() > kSamePoint;
        }))
      starts.push_back(k);
  return starts;
}

double nearest_part(const Vector3& to_point, const Vector3& along) {
  // The square is zero where a joint has slid to the one before.
  const double square = std::max(along.squaredNorm(), std::numeric_limits<double>::min());
  return std::clamp(to_point.dot(along) / square, 0.0, 1.0);
}

std::vector<int> near_box(const std::vector<ArmPoints>& points, const Values& times,
                          const std::vector<Sphere>& spheres, double distance) {
  Eigen::AlignedBox3d box;
  for (const ArmPoints& arm : points)
    for (int k = 0; k < arm.cols(); ++k) box.extend(arm.col(k));
  std::vector<int> near;
  for (size_t sphere = 0; sphere < spheres.size(); ++sphere) {
    const Eigen::AlignedBox3d way = spheres[sphere].way(times);
    if (box.exteriorDistance(way) <= spheres[sphere].radius + distance)
      near.push_back(static_cast<int>(sphere));
  }
  return near;
}

Gradient ClearanceRows::add(double distance, long long name, Eigen::Index columns) {
  distances.push_back(distance);
  names.push_back(name);
  jacobian.resize(jacobian.size() + columns, 0.);
  return {jacobian.data() + jacobian.size() - columns, columns};
}

ClearanceRows clearance_rows(const ArmMotion& arm, const Times& times,
                             const std::vector<Sphere>& spheres, double interest) {
  ClearanceRows rows;
  const std::vector<int> near = near_box(arm.points, times.at, spheres, interest);
  const std::vector<int> starts = segments(arm.points);
  const Eigen::Index lines = arm.points[0].cols() - 1;  // with those that have no length
  std::vector<Vector3> centers(spheres.size());
  for (size_t i = 0; i < arm.points.size() && !near.empty(); ++i) {
    Deadline::require();
    for (const int sphere : near) centers[sphere] = spheres[sphere].center_at(times.at[i]);
    for (const int k : starts)
      for (const int sphere : near) {
        const Vector3& center = centers[sphere];
        const Vector3 start = arm.points[i].col(k), along = arm.points[i].col(k + 1) - start;
        const double fraction = nearest_part(center - start, along);
        const Vector3 offset = start + fraction * along - center;
        const double to_center = offset.norm(), distance = to_center - spheres[sphere].radius;
        if (std::isnan(distance)) throw std::domain_error("a distance is not a number");
        if (!(distance < interest)) continue;
        const Vector3 direction = offset / std::max(to_center, kSamePoint);
        const size_t name = (i * lines + k) * spheres.size() + sphere;
        Gradient gradient = rows.add(distance, static_cast<long long>(name), arm.variables());
        arm.add_gradient(i, k, fraction, direction, gradient);
        if (times.by_last.size() > 0)
          gradient[gradient.size() - 1] -=
              times.by_last[i] * direction.dot(spheres[sphere].velocity_at(times.at[i]));
      }
  }
  return rows;
}

}  // namespace ff
