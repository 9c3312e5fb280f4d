// Joint accelerations at the points of a path, of which positions and rates are known.
#pragma once
#include "optimisation/limit_rows.hpp"

namespace ff {

// The acceleration at a point is that of the quintic through both positions and rates there and at
// its neighbours: exact for quintics, of fourth order in the step for other motions.
RowMajor accelerations_at_points(const Table& positions, const Table& rates, double step);

// Joint accelerations at all points and, once they are asked for, their derivatives: a row a point.
struct JointAccelerations {
  RowMajor values, by_x;

  JointAccelerations(const JointsAtPoints& of, double step)
      : values(accelerations_at_points(of.positions, of.rates, step)) {}

  // has_duration: is the last variable the duration?
  void differentiate(const JointsAtPoints& of, double step, bool has_duration);
};

}  // namespace ff
