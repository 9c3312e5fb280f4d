#include "collision/obstacles.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

Pose Obstacle::at(double time) const {
  if (body) return body->pose(time) * begin;
  const double turn = rate.norm();
  if (turn == 0) return {begin.position + time * velocity, begin.rotation};
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
  const double around = (center - there * obstacle.center).norm() - obstacle.radius;
  const bool closed = obstacle.solid.kind < Solid::kHull;
  return (closed ? std::max(around, gap(obstacle.solid, there, center).distance) : around) - radius;
}

ObstaclesAt::ObstaclesAt(const std::vector<Obstacle>& obstacles, const Values& times)
    : times_(times) {
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

ClearanceRows obstacle_rows(const BodiesAlong& along, const Times& times,
                            const std::vector<Obstacle>& obstacles, double interest) {
  const Bodies& of = along.of;
  const auto count = static_cast<long long>(of.bodies.size() * obstacles.size());
  const int bodies = static_cast<int>(of.bodies.size());
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
      const double around = of.bodies[body].radius + interest;
      if (apart(moved, way) >= around + obstacle.radius) continue;
      if (obstacle.rests() &&
          bound(moved.center(), moved.diagonal().norm() / 2, obstacle, obstacle.begin) >= around)
        continue;
      near.push_back({body, static_cast<int>(number), {}});
    }
  }
  const auto rows_of = [&](size_t first, size_t last) {
    ClearanceRows rows;
    for (size_t i = 0; i < along.placed.size(); ++i) {
      Deadline::require();
      const PlacedBodies& placed = along.placed[i];
      const Pose here{along.at[i].position, along.at[i].attitude.toRotationMatrix()};
      const Pose to_base = here.inverse();
      RowMajor by_x;
      Pose there;
      for (size_t number = first; number < last; ++number) {
        Near& pair = near[number];
        const Body& solid = of.bodies[pair.body];
        const Obstacle& obstacle = obstacles[pair.obstacle];
        if (number == first || pair.obstacle != near[number - 1].obstacle)
          there = to_base * obstacles_at.pose(obstacle, i);
        if (bound(placed.centers[pair.body], solid.radius, obstacle, there) >= interest) continue;
        const Gap found =
            gap(solid.solid, placed.solids[pair.body], obstacle.solid, there, pair.known, interest);
        const long long name =
            static_cast<long long>(i) * count +
            static_cast<long long>(pair.body) * static_cast<long long>(obstacles.size()) +
            pair.obstacle;
        if (!counts(found.distance, interest)) continue;
        if (by_x.size() == 0) by_x = along.path.derivatives(i);
        auto row = rows.add(found.distance, name, by_x.cols());
        const Velocity by_q = placed.gradient(found, solid.carriers);
        row.noalias() = by_q.transpose() * by_x.topRows(by_q.size());
        if (times.by_last.size() > 0)
          row[row.size() - 1] +=
              times.by_last[i] * (here.rotation * found.normal)
                                     .dot(obstacle.velocity_at(here * found.point, times.at[i]));
      }
    }
    return rows;
  };
  return rows_in_threads(near.size(), along.placed.size(), count, rows_of);
}

}  // namespace ff
