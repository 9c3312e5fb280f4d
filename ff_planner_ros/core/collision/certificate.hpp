// Lower bounds of distances along a whole motion, between its points too, while a search goes on.
// They share nothing with those of the check: neither the motion between points nor how far bodies
// move there.
#pragma once
#include "collision/obstacles.hpp"

namespace ff {

// A motion from point to point: between two, the cubic in the tangent space of the first through
// both configurations and velocities.
struct CubicMotion {
  Chain chain;
  std::vector<Configuration> q;  // at the points
  RowMajor cubics;               // of s, s^2, s^3 to the next point, three rows each
  Eigen::VectorXd times;

  // v: tangent velocities, a row a point.
  CubicMotion(const Chain& chain, std::vector<Configuration> at, const Rows& v,
              const Values& times);

  // At a part s of the way from a point to the next.
  Configuration at(int point, double s) const;
};

// Which of some numbered distances a certificate is asked of, until which point, and how closely:
// to `gap` [m], or to `part` of the least.
struct Asked {
  std::vector<int> numbers;
  int last;
  double gap, part;
};

// Of pairs of bodies, by their numbers. In a piece of the motion a distance is at least the mean of
// both ends' less half the way that both move against each other. Pieces whose bound is too low to
// tell are halved until the bound is as close as is asked, or there are too many of them: then it
// is what it is.
double certified_pairs(const CubicMotion& motion, const Bodies& bodies, const Asked& asked);

// Likewise of bodies and obstacles; the number is body times obstacles plus obstacle.
double certified_obstacles(const CubicMotion& motion, const Bodies& bodies,
                           const Obstacles& obstacles, const Asked& asked);

}  // namespace ff
