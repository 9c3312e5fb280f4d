// Steps of order four on the configuration manifold, and their derivatives.
//
// The base moves on SE(3), where Runge-Kutta's weighted sum of velocities alone has order two. The
// brackets of Munthe-Kaas restore order four [Munthe-Kaas, High order Runge-Kutta methods on
// manifolds, Appl. Numer. Math. 29, 1999].
//
// The stages of a step of h seconds lie at 0, 1/2, 1/2 and 1. Their tangent steps are
//     u2 = h/2 v1,   u3 = h/2 v2 + h^2/8 [v1, v2],   u4 = h v3,
//     u  = h/6 (v1 + 2 v2 + 2 v3 + v4) + h^2/12 [v1, v4].
#pragma once
#include "velocity_map.hpp"

namespace ff {

// weight [a, b] is added to the base part of a step.
inline void add_bracket(Velocity& step, double weight, const Velocity& a, const Velocity& b) {
  step.head<6>() += weight * cross_motion(a.head<6>(), b.head<6>());
}

template <int columns>
void add_bracket_derivative(Along<columns>& d_step, double weight, const Velocity& a,
                            const Along<columns>& da, const Velocity& b, const Along<columns>& db) {
  const Matrix6 ad_a = weight * cross_motion_matrix(a.head<6>());
  const Matrix6 ad_b = weight * cross_motion_matrix(b.head<6>());
  add_product(d_step.template topRows<6>(), ad_a, db.template topRows<6>());
  add_product(d_step.template topRows<6>(), -ad_b, da.template topRows<6>());
}

// Derivative of where the step `by` leads, of those of its beginning and of the step.
template <int columns>
Along<columns> carried(const Along<columns>& dq, const Velocity& by, const Along<columns>& d_by) {
  const Vector6 of_base = by.head<6>();
  Along<columns> result = dq + d_by;  // of the joints
  auto base = result.template topRows<6>();
  base.setZero();
  add_product(base, exponential(of_base).motion_to_inner(), dq.template topRows<6>());
  add_product(base, exponential_derivative(of_base), d_by.template topRows<6>());
  return result;
}

}  // namespace ff
