// A lower bound of the distances of bodies from obstacles of any shape along a whole motion.
#pragma once
#include "collision/body_certificate.hpp"
#include "collision/obstacles.hpp"

namespace ff {

// Bodies and obstacles; the number is body times obstacles plus obstacle.
struct ObstaclesOnTheWay {
  BodiesOnTheWay& bodies;
  RowMajor ways;  // of a body, as in `sums_of`
  const std::vector<Obstacle>& obstacles;
  std::map<int, Simplex> known = {};

  const Obstacle& obstacle(int number) const { return obstacles[number % obstacles.size()]; }
  int body(int number) const { return number / static_cast<int>(obstacles.size()); }
  // As the chaser sees it.
  Pose seen(const BodiesOnTheWay::At& at, const Obstacle& obstacle) const {
    const Pose there = obstacle.at(at.time);
    return {at.to_base * (there.position - at.base), at.to_base * there.rotation};
  }

  double bound(int number, double step) {
    const BodiesOnTheWay::At& at = bodies.at(step);
    const Body& of = bodies.of.bodies[body(number)];
    return ff::bound(at.placed.centers[body(number)], of.radius, obstacle(number),
                     seen(at, obstacle(number)));
  }
  double distance(int number, double step) {
    const BodiesOnTheWay::At& at = bodies.at(step);
    return gap(bodies.of.bodies[body(number)].solid, at.placed.solids[body(number)],
               obstacle(number).solid, seen(at, obstacle(number)), known[number])
        .distance;
  }
  double way(int number, double begin, double end) const {
    return bodies.grown(ways, end, body(number)) - bodies.grown(ways, begin, body(number)) +
           (bodies.time(end) - bodies.time(begin)) * obstacle(number).highest_speed;
  }
};

}  // namespace ff
