// Steps of order four on a Lie group, and their derivatives.
//
// On SE(3) and SO(3) Runge-Kutta's weighted sum of velocities alone has order two. The brackets of
// Munthe-Kaas restore order four [Munthe-Kaas, High order Runge-Kutta methods on manifolds, Appl.
// Numer. Math. 29, 1999].
//
// The stages of a step of h seconds lie at 0, 1/2, 1/2 and 1. The tangent steps to the next stage,
// the last of them the whole step, are
//     h/2 v0,   h/2 v1 + h^2/8 [v0, v1],   h v2,   h/6 (v0 + 2 v1 + 2 v2 + v3) + h^2/12 [v0, v3].
#pragma once
#include <array>

namespace ff {

// Of velocities, of their derivatives, or of tangent steps.
template <typename T>
using Stages = std::array<T, 4>;

constexpr Stages<int> kHalfSteps{0, 1, 1, 2};  // from the beginning of a step to each stage

template <typename T>
T weighted_sum(int stage, double h, const Stages<T>& of) {
  if (stage == 3) return h / 6 * (of[0] + 2 * of[1] + 2 * of[2] + of[3]);
  return (stage == 2 ? h : h / 2) * of[stage];
}
constexpr bool has_bracket(int stage) { return stage == 1 || stage == 3; }
constexpr double bracket_weight(int stage, double h) { return h * h / (stage == 1 ? 8 : 12); }

// v: at the stages up to this one. Group: that of the configurations.
template <typename Group, typename Velocity>
Velocity tangent_step(int stage, double h, const Stages<Velocity>& v) {
  Velocity u = weighted_sum(stage, h, v);
  if (has_bracket(stage)) Group::add_bracket(u, bracket_weight(stage, h), v[0], v[stage]);
  return u;
}

// d: derivatives of the velocities v. `stretch` adds what changes with the duration: h is a part of
// it, and what is of order h^k grows by k / T of itself.
template <typename Group, typename Velocity, typename Derivative>
Derivative tangent_step_derivative(const Group& group, int stage, double h,
                                   const Stages<Velocity>& v, const Velocity& u,
                                   const Stages<Derivative>& d) {
  Derivative du = weighted_sum(stage, h, d);
  if (!has_bracket(stage)) {
    group.stretch(du, u);
    return du;
  }
  const double weight = bracket_weight(stage, h);
  Group::add_bracket_derivative(du, weight, v[0], d[0], v[stage], d[stage]);
  group.stretch(du, u, weight, v[0], v[stage]);
  return du;
}

// The point half-way: the errors of both stages there cancel in their mean.
template <typename T>
T half_way(const Stages<T>& u) {
  return (u[0] + u[1]) / 2;
}

}  // namespace ff
