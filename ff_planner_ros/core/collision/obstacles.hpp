// Obstacles of any convex shape, and how far a robot's bodies are from them. They rest, move
// uniformly and turn at a constant rate, or are fixed to a body that turns freely.
#pragma once
#include "collision/bodies.hpp"

namespace ff {

struct Obstacle {
  Solid solid;
  Vector3 center;  // in its frame, of a sphere around it
  double radius;   // of that sphere
  Pose begin;      // when the plan begins; or, where it is fixed to a body, in that
  Vector3 velocity, rate;
  double highest_speed;                      // that no point of it ever exceeds [m/s]
  std::shared_ptr<const TumblingBody> body;  // none: it moves uniformly

  bool rests() const { return !body && velocity.isZero(0) && rate.isZero(0); }

  Pose at(double time) const {
    if (body) return body->pose(time) * begin;
    const double turn = rate.norm();
    if (turn == 0) return {begin.position + time * velocity, begin.rotation};
    return {begin.position + time * velocity,
            Eigen::AngleAxisd(turn * time, rate / turn).toRotationMatrix() * begin.rotation};
  }
  // Of what is fixed to it and at a point then [m/s].
  Vector3 velocity_at(const Vector3& point, double time) const {
    if (body) {
      const Pose pose = body->pose(time);
      return body->speed(pose.rotation.transpose() * (point - pose.position), time);
    }
    return velocity + rate.cross(point - begin.position - time * velocity);
  }
};

// A bound of how far a body is from an obstacle, by a sphere around the body, both seen from one
// frame; where that has no closed form, by the sphere around the obstacle, too.
inline double bound(const Vector3& center, double radius, const Obstacle& obstacle,
                    const Pose& there) {
  const double around = (center - there * obstacle.center).norm() - obstacle.radius;
  const bool closed = obstacle.solid.kind < Solid::kHull;
  return (closed ? std::max(around, gap(obstacle.solid, there, center).distance) : around) - radius;
}

// As `sphere_rows`; names: configuration, body, then obstacle.
inline BodyRows obstacle_rows(const Chain& chain, const Bodies& of, const Path& path,
                              const Times& times, const std::vector<Obstacle>& obstacles,
                              double interest) {
  BodyRows rows;
  const auto count = static_cast<long long>(of.bodies.size() * obstacles.size());
  const int bodies = static_cast<int>(of.bodies.size());
  std::vector<Configuration> at;
  std::vector<PlacedBodies> placed;
  std::vector<Eigen::AlignedBox3d> ways(bodies);  // of the bodies' centres, in the inertial frame
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    at.push_back(Configuration::read(path.q.row(i)));
    placed.emplace_back(chain, of, at[i].joints);
    for (int body = 0; body < bodies; ++body)
      ways[body].extend(at[i].position + at[i].attitude * placed[i].centers[body]);
  }
  // What is never near costs nothing: of an obstacle, the bodies that come into its sphere, or, if
  // it rests, near what the box around their way is from it.
  struct Near {
    int body, obstacle;
    Simplex known;
  };
  std::vector<Near> near;
  std::vector<bool> is_near(obstacles.size(), false);
  for (size_t number = 0; number < obstacles.size(); ++number) {
    const Obstacle& obstacle = obstacles[number];
    Eigen::AlignedBox3d way;
    for (const double time : times.at) {
      way.extend(obstacle.at(time) * obstacle.center);
      if (obstacle.rests()) break;
    }
    for (int body = 0; body < bodies; ++body) {
      const double around = of.bodies[body].radius + interest;
      if (ways[body].exteriorDistance(way) >= around + obstacle.radius) continue;
      if (obstacle.rests() && bound(ways[body].center(), ways[body].diagonal().norm() / 2, obstacle,
                                    obstacle.begin) >= around)
        continue;
      near.push_back({body, static_cast<int>(number), {}});
      is_near[number] = true;
    }
  }
  std::vector<Pose> seen(obstacles.size());
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    const Pose to_base = Pose{at[i].position, at[i].attitude.toRotationMatrix()}.inverse();
    const auto by_x = path.derivatives(i);
    for (size_t number = 0; number < obstacles.size(); ++number)
      if (is_near[number]) seen[number] = to_base * obstacles[number].at(times.at[i]);
    for (Near& pair : near) {
      const Body& solid = of.bodies[pair.body];
      const Obstacle& obstacle = obstacles[pair.obstacle];
      const Pose& there = seen[pair.obstacle];
      if (bound(placed[i].centers[pair.body], solid.radius, obstacle, there) >= interest) continue;
      const Gap found = gap(solid.solid, placed[i].solids[pair.body], obstacle.solid, there,
                            pair.known, interest);
      const long long name =
          static_cast<long long>(i) * count +
          static_cast<long long>(pair.body) * static_cast<long long>(obstacles.size()) +
          pair.obstacle;
      if (!found.is_known) rows.unknown.push_back(name);
      if (std::isnan(found.distance)) throw std::domain_error("a distance is not a number");
      if (!found.is_known || !(found.distance < interest)) continue;
      auto row = rows.add(found.distance, name, by_x.cols());
      // Seen from a chaser that moves, an obstacle moves the other way.
      const Vector3 by_turn = -found.point.cross(found.normal);
      row -= found.normal.transpose() * by_x.topRows<3>();
      row += by_turn.transpose() * by_x.middleRows<3>(3);
      for (int k = 0; k < solid.carriers; ++k) row -= placed[i].along(found, k) * by_x.row(6 + k);
      if (times.by_last.size() > 0) {
        const Matrix3 to_inertial = at[i].attitude.toRotationMatrix();
        const Vector3 point = at[i].position + to_inertial * found.point;
        row[row.size() - 1] +=
            times.by_last[i] *
            (to_inertial * found.normal).dot(obstacle.velocity_at(point, times.at[i]));
      }
    }
  }
  return rows;
}

}  // namespace ff
