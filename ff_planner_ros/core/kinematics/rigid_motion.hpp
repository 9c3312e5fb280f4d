// Finite motions of the base: exp on SE(3) and its derivative.
#pragma once
#include "kinematics/spatial.hpp"

namespace ff {

// The functions of an angle x that exp on SE(3) and its derivative are made of. Near zero their
// closed forms lose digits, and their series, cut after five terms, have an error below 1e-17.
struct AngleFunctions {
  double b, c;            // (1 - cos x) / x^2, (x - sin x) / x^3
  double b_rate, c_rate;  // their derivatives, over x

  explicit AngleFunctions(double square);
};

// Where a body gets that moves by `step` in its own frame.
Pose exponential(const Vector6& step);

// Its derivative, in the frame where the body got to. It is that on SO(3) of the dual numbers
// w + epsilon v in place of w.
Matrix6 exponential_derivative(const Vector6& step);

// The rotation part of `exponential`, as a quaternion.
Eigen::Quaterniond turn(const Vector6& step);

}  // namespace ff
