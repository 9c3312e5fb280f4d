// A lower bound of the clearance along a whole motion, between its points too, while a search goes
// on. Between two points the motion is the cubic through both configurations and velocities.
#pragma once
#include "collision/clearance.hpp"

namespace ff {

// Distance of the arm from a sphere, negative inside.
double nearest(const ArmPoints& points, const std::vector<int>& starts, const Sphere& sphere,
               double time);

// A motion from point to point.
struct CubicMotion {
  Chain chain;
  std::vector<Configuration> q;  // at the points
  RowMajor cubics;               // of s, s^2, s^3 to the next point, three rows each
  Eigen::VectorXd times;

  // At a part s of the way from a point to the next.
  Configuration at(int point, double s) const;
};

// In a piece of the motion the distance from a sphere is at least the mean of both ends' less half
// the ways of arm and sphere. Pieces whose bound is too low to tell are halved, until it is within
// `gap` or `part` of the least, or they are as short as numbers can tell, or there are too many.
// `ways`: that no point of the arm exceeds to the next point [m].
double certified_clearance(const CubicMotion& motion, const Values& ways,
                           const std::vector<Sphere>& spheres, double gap, double part);

}  // namespace ff
