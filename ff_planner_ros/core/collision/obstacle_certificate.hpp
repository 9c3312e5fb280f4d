// A lower bound of the distances of bodies from obstacles of any shape along a whole motion.
#pragma once
#include "collision/body_certificate.hpp"
#include "collision/obstacles.hpp"

namespace ff {

// Bodies and obstacles; the number is body times obstacles plus obstacle.
struct ObstaclesOnTheWay : DistancesOnTheWay {
  BodiesOnTheWay& bodies;
  RowMajor ways;  // of a body, as in `sums_of`
  const std::vector<Obstacle>& obstacles;
  std::map<int, Simplex> known;

  ObstaclesOnTheWay(BodiesOnTheWay& bodies, RowMajor ways, const std::vector<Obstacle>& obstacles)
      : bodies(bodies), ways(std::move(ways)), obstacles(obstacles) {}

  const Obstacle& obstacle(int number) const { return obstacles[number % obstacles.size()]; }
  int body(int number) const { return number / static_cast<int>(obstacles.size()); }
  // As the chaser sees it.
  Pose seen(const BodiesOnTheWay::At& at, const Obstacle& obstacle) const;

  double bound(int number, double step) override;
  double distance(int number, double step) override;
  double way(int number, double begin, double end) const override;
};

}  // namespace ff
