// Momenta and torques of the wheels that hold the chaser's attitude along a path.
#pragma once
#include "kinematics/held_momentum.hpp"
#include "program/joint_accelerations.hpp"
#include "program/path_motion.hpp"

namespace ff {

struct Wheels {
  RowMajor shares;         // of each wheel, a row each, in what the base's axes hold
  Eigen::VectorXd stored;  // by each at the start [N m s]

  Eigen::Index count() const { return shares.rows(); }
};

// A row a point; of derivatives, those of one wheel after those of another.
struct WheelLoads {
  RowMajor momenta, momenta_by_x;  // [N m s]
  RowMajor torques, torques_by_x;  // [N m]

  WheelLoads(const Chain& chain, const Wheels& wheels, const PathMotion& motion,
             const PathDerivatives& by_x, double step);
};

}  // namespace ff
