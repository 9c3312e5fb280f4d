#include "collision/obstacle_certificate.hpp"

namespace ff {

Pose ObstaclesOnTheWay::seen(const BodiesOnTheWay::At& at, const Obstacle& obstacle) const {
  const Pose there = obstacle.at(at.time);
  return {at.to_base * (there.position - at.base), at.to_base * there.rotation};
}

double ObstaclesOnTheWay::bound(int number, double step) {
  const BodiesOnTheWay::At& at = bodies.at(step);
  const Body& of = bodies.of.bodies[body(number)];
  return ff::bound(at.placed.centers[body(number)], of.radius, obstacle(number),
                   seen(at, obstacle(number)));
}

double ObstaclesOnTheWay::distance(int number, double step) {
  const BodiesOnTheWay::At& at = bodies.at(step);
  return gap(bodies.of.bodies[body(number)].solid, at.placed.solids[body(number)],
             obstacle(number).solid, seen(at, obstacle(number)), known[number])
      .distance;
}

double ObstaclesOnTheWay::way(int number, double begin, double end) const {
  return bodies.grown(ways, end, body(number)) - bodies.grown(ways, begin, body(number)) +
         (bodies.time(end) - bodies.time(begin)) * obstacle(number).highest_speed;
}

}  // namespace ff
