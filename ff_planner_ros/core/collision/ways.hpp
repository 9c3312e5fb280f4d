// How far bodies move along a motion at most. A joint that turns moves a place at most by its angle
// times the lever, which is no longer than the stretched arm and the body at its end together.
#pragma once
#include "collision/certificate.hpp"

namespace ff {

// Upper bounds that grow along a motion: what they grow by between two steps, which are points or
// parts of the way between two, is a bound of the way there.
class Ways {
 public:
  // A row an interval, a column a way.
  explicit Ways(const RowMajor& in_intervals);

  double between(double begin, double end, int column) const {
    return until(end, column) - until(begin, column);
  }

 private:
  double until(double step, int column) const;

  RowMajor sums_;  // a row a point
};

// Of each body, seen from the inertial frame.
Ways ways_of_bodies(const CubicMotion& motion, const Bodies& of);

// Of each pair of bodies against each other.
Ways ways_of_pairs(const CubicMotion& motion, const Bodies& of);

// A speed that no point of an obstacle exceeds which is nearest to something [m/s].
// fastest_turn: of the body that it is fixed to [rad/s].
double highest_speed(const Obstacle& obstacle, double fastest_turn);

}  // namespace ff
