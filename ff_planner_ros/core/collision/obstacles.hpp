// Obstacles of any convex shape, and how far a robot's bodies are from them. They rest, move
// uniformly and turn at a constant rate, or are fixed to a body that turns freely.
#pragma once
#include <map>
#include <memory>

#include "collision/bodies.hpp"
#include "collision/threads.hpp"
#include "collision/tumbling_body.hpp"

namespace ff {

struct Obstacle {
  Solid solid;
  Vector3 center;  // in its frame, of a sphere around it
  double radius;   // of that sphere
  Pose begin;      // when the plan begins; or, where it is fixed to a body, in that
  Vector3 velocity, rate;
  std::shared_ptr<const TumblingBody> body;  // none: it moves uniformly

  bool turns() const { return body || !rate.isZero(0); }
  bool rests() const { return !turns() && velocity.isZero(0); }

  Pose at(double time) const;
  // Of what is fixed to it and at a point then [m/s].
  Vector3 velocity_at(const Vector3& point, double time) const;
};

// A type of its own: Python holds it, and it is not copied with every question.
struct Obstacles : std::vector<Obstacle> {};

// How a robot's base sees what is around it.
struct View {
  Pose base, to_base;

  explicit View(const Configuration& q)
      : base{q.position, q.attitude.toRotationMatrix()}, to_base(base.inverse()) {}
  // Of spheres the place alone counts.
  Pose of(const Obstacle& obstacle, const Pose& there) const {
    if (!obstacle.solid.is_sphere()) return to_base * there;
    return {to_base.rotation * (there.position - base.position), there.rotation};
  }
};

// A bound of how far a body is from an obstacle, by a sphere around the body, both seen from one
// frame; where that has no closed form, by the sphere around the obstacle, too.
double bound(const Vector3& center, double radius, const Obstacle& obstacle, const Pose& there);

// How far a solid is from an obstacle; `known` and `enough` are those of `gap`.
Gap gap(const Solid& solid, const Pose& at, const Obstacle& obstacle, const Pose& there,
        Simplex& known, double enough = std::numeric_limits<double>::infinity());

// Where obstacles are at some times; what is fixed to one body shares its poses.
class ObstaclesAt {
 public:
  ObstaclesAt(const Obstacles& obstacles, const Values& times);
  Pose pose(const Obstacle& obstacle, Eigen::Index i) const;
  // The box around the centre of an obstacle at all times.
  Eigen::AlignedBox3d way(const Obstacle& obstacle) const;

 private:
  Values times_;
  std::map<const TumblingBody*, std::vector<Pose>> of_bodies_;
};

// As `pair_rows`; a pair is body times obstacles plus obstacle.
DistanceRows obstacle_rows(const BodiesAlong& along, const Times& times, const Obstacles& obstacles,
                           double interest);

}  // namespace ff
