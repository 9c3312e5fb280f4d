#include "collision/obstacles.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

Pose Obstacle::at(double time) const {
  if (body) return body->pose(time) * begin;
  if (rate.isZero(0)) return {begin.position + time * velocity, begin.rotation};
  const double turn = rate.norm();
  return {begin.position + time * velocity,
          Eigen::AngleAxisd(turn * time, rate / turn).toRotationMatrix() * begin.rotation};
}

Vector3 Obstacle::velocity_at(const Vector3& point, double time) const {
  if (body) {
    const Pose pose = body->pose(time);
    return body->speed(pose.rotation.transpose() * (point - pose.position), time);
  }
  return velocity + rate.cross(point - begin.position - time * velocity);
}

double bound(const Vector3& center, double radius, const Obstacle& obstacle, const Pose& there) {
  const Solid& solid = obstacle.solid;
  if (solid.is_sphere()) return (center - there.position).norm() - solid.radius() - radius;
  const double around = (center - there * obstacle.center).norm() - obstacle.radius;
  const bool closed = solid.kind < Solid::kHull;
  return (closed ? std::max(around, gap(solid, there, center).distance) : around) - radius;
}

Gap gap(const Solid& solid, const Pose& at, const Obstacle& obstacle, const Pose& there,
        Simplex& known, double enough) {
  if (!obstacle.solid.is_sphere()) return gap(solid, at, obstacle.solid, there, known, enough);
  Gap found = gap(solid, at, there.position);
  found.distance -= obstacle.solid.radius();
  return found;
}

ObstaclesAt::ObstaclesAt(const Obstacles& obstacles, const Values& times) : times_(times) {
  for (const Obstacle& obstacle : obstacles) {
    if (!obstacle.body) continue;
    std::vector<Pose>& poses = of_bodies_[obstacle.body.get()];
    if (poses.empty())
      for (const double time : times) poses.push_back(obstacle.body->pose(time));
  }
}

Pose ObstaclesAt::pose(const Obstacle& obstacle, Eigen::Index i) const {
  if (obstacle.body) return of_bodies_.at(obstacle.body.get())[i] * obstacle.begin;
  return obstacle.at(times_[i]);
}

Eigen::AlignedBox3d ObstaclesAt::way(const Obstacle& obstacle) const {
  Eigen::AlignedBox3d box;
  if (!obstacle.turns()) {  // it flies straight on
    box.extend(obstacle.at(times_.minCoeff()) * obstacle.center);
    return box.extend(obstacle.at(times_.maxCoeff()) * obstacle.center);
  }
  for (Eigen::Index i = 0; i < times_.size(); ++i) box.extend(pose(obstacle, i) * obstacle.center);
  return box;
}

DistanceRows obstacle_rows(const BodiesAlong& along, const Times& times, const Obstacles& obstacles,
                           double interest) {
  const int bodies = static_cast<int>(along.of.bodies.size());
  const auto others = static_cast<long long>(obstacles.size()), count = bodies * others;
  const ObstaclesAt obstacles_at(obstacles, times.at);
  // What is never near costs nothing: of an obstacle, the bodies that come into its sphere, or, if
  // it rests, near what the box around their way is from it.
  struct Near {
    int body, obstacle;
    Simplex known;
  };
  std::vector<Near> near;
  for (size_t number = 0; number < obstacles.size(); ++number) {
    const Obstacle& obstacle = obstacles[number];
    const Eigen::AlignedBox3d way = obstacles_at.way(obstacle);
    for (int body = 0; body < bodies; ++body) {
      const Eigen::AlignedBox3d& moved = along.ways[body];
      const double around = along.of.bodies[body].radius + interest;
      if (apart(moved, way) >= around + obstacle.radius) continue;
      if (obstacle.rests() && !obstacle.solid.is_sphere() &&
          bound(moved.center(), moved.diagonal().norm() / 2, obstacle, obstacle.begin) >= around)
        continue;
      near.push_back({body, static_cast<int>(number), {}});
    }
  }
  // Spheres are many, and those near one body come in turn; others have poses that bodies share.
  const auto turn = [&](const Near& pair) {
    return obstacles[pair.obstacle].solid.is_sphere() ? pair.body : bodies;
  };
  std::stable_sort(near.begin(), near.end(),
                   [&](const Near& a, const Near& b) { return turn(a) < turn(b); });
  const auto rows_of = [&](size_t first, size_t last) {
    DistanceRows rows;
    for (size_t i = 0; i < along.placed.size(); ++i) {
      Deadline::require();
      const PlacedBodies& placed = along.placed[i];
      const View view(along.at[i]);
      RowMajor by_x;
      Pose there;
      for (size_t number = first; number < last; ++number) {
        Near& pair = near[number];
        const Obstacle& obstacle = obstacles[pair.obstacle];
        if (number == first || pair.obstacle != near[number - 1].obstacle)
          there = view.of(obstacle, obstacles_at.pose(obstacle, i));
        const double radius = along.of.bodies[pair.body].radius;
        if (bound(placed.centers[pair.body], radius, obstacle, there) >= interest) continue;
        if (along.of.bodies[pair.body].stretches()) pair.known = {};
        const Gap found = gap(placed.solid(pair.body), placed.poses[pair.body], obstacle, there,
                              pair.known, interest);
        if (!counts(found.distance, interest)) continue;
        if (by_x.size() == 0) by_x = along.path.derivatives(i);
        const long long name = i * count + pair.body * others + pair.obstacle;
        auto row = rows.add(found.distance, name, by_x.cols());
        const Velocity by_q = placed.gradient(found, pair.body);
        row.noalias() = by_q.transpose() * by_x.topRows(by_q.size());
        if (times.by_last.size() == 0) continue;
        const Vector3 moved = obstacle.velocity_at(view.base * found.point, times.at[i]);
        row[row.size() - 1] += times.by_last[i] * found.normal.dot(view.to_base.rotation * moved);
      }
    }
    return rows;
  };
  return rows_in_threads(near.size(), along.placed.size(), count, rows_of);
}

}  // namespace ff
