// The motions that follow from polynomial paths of the end effector, with their derivatives by the
// 18 coefficients: the velocity map at each stage of a Runge-Kutta step, Eqs. (27) and (31).
//
// Where the duration T is one more variable, its column goes through the same stages. The times of
// the stages are fixed parts s of T, where the twist changes as the polynomial says, and the bias
// as the start's accelerations do; and every step h is a part of T, so that a tangent step of order
// h^k grows by k / T of itself.
#pragma once
#include "motion/polynomial.hpp"

namespace ff {

// Where the results go: a row a point, and a block of rows for the derivatives, which begin with d.
struct RolloutArrays {
  RowsToFill q, v, q_half_way, dq, dv, dq_half_way;
  RowsToFill acceleration;  // dv/dt itself
};

// The motion's half-step at which it meets a singularity, if it meets none.
constexpr int kRegular = -1;

// Where a motion begins and what it follows.
struct EndEffectorRollout {
  Chain chain;
  Configuration start;
  Vector6 momentum;
  EndEffectorPolynomial polynomial;
  NullSpaceFade null_space;
  int points;
  double damping;

  // The coefficients, and the duration if the polynomial moves with it.
  int variables() const { return kParameters + polynomial.quintic_by_duration.has_value(); }
  // Returns the half-step at which the motion meets a dynamic singularity, or kRegular.
  int run(const Coefficients& coefficients, RolloutArrays to) const;
};

}  // namespace ff
