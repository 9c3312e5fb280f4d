// The motions that follow from polynomial paths of the end effector, with their derivatives by the
// 18 coefficients: the velocity map at each stage of a Runge-Kutta step, Eqs. (27) and (31).
//
// Where the duration T is one more variable, its column goes through the same stages. The times of
// the stages are fixed parts s of T, where the twist changes as the polynomial says, and the bias
// as the start's accelerations do; and every step h is a part of T, so that a tangent step of order
// h^k grows by k / T of itself.
#pragma once
#include "polynomial.hpp"
#include "runge_kutta.hpp"

namespace ff {

// Where the results go: rows of points, each with room for the derivatives where it begins with d.
struct RolloutArrays {
  double *q, *v, *q_half_way;  // (points, 7 + joints), (points, 6 + joints), one row fewer
  double *dq, *dv, *dq_half_way;
  double* acceleration;  // dv/dt itself; (points, 6 + joints)
};

// The motion's half-step at which it meets a singularity, if it meets none.
constexpr int kRegular = -1;

// columns: the coefficients, and the duration if it is one more.
template <int columns>
class EndEffectorRollout {
 public:
  static constexpr bool kFreeDuration = columns > kParameters;
  using Sensitivity = Along<columns>;

  EndEffectorRollout(const Chain& chain, const Vector6& momentum,
                     const EndEffectorPolynomial& polynomial, const NullSpaceFade& null_space,
                     const Coefficients& coefficients, int points, double damping)
      : chain_(chain),
        momentum_(momentum),
        polynomial_(polynomial),
        null_space_(null_space),
        coefficients_(coefficients),
        points_(points),
        damping_(damping) {}

  // Returns the half-step at which the motion meets a dynamic singularity, or kRegular.
  int run(Configuration q, const RolloutArrays& to) const {
    const int size = 6 + chain_.joints();
    const double h = polynomial_.duration / (points_ - 1);
    Sensitivity dq = Sensitivity::Zero(size, columns);
    for (int i = 0; i < points_; ++i) {
      const int begin = 2 * i, middle = begin + 1, end = begin + 2;
      VelocityMap first = map(q, begin);
      if (!first.regular) return begin;
      const Sensitivity d1 = derivative(first, dq, begin);
      write_point(to, i, q, dq, first, d1);
      if (i == points_ - 1) break;

      const Velocity& v1 = first.v;
      const Velocity u2 = h / 2 * v1;
      VelocityMap second = map(q.step(u2), middle);
      if (!second.regular) return middle;
      Sensitivity du2 = h / 2 * d1;
      stretch(du2, u2);
      const Sensitivity d2 = derivative(second, carried(dq, u2, du2), middle);

      const Velocity& v2 = second.v;
      Velocity u3 = h / 2 * v2;
      add_bracket(u3, h * h / 8, v1, v2);
      VelocityMap third = map(q.step(u3), middle);
      if (!third.regular) return middle;
      Sensitivity du3 = h / 2 * d2;
      add_bracket_derivative(du3, h * h / 8, v1, d1, v2, d2);
      stretch(du3, u3);
      stretch(du3, bracket(h * h / 8, v1, v2));
      const Sensitivity d3 = derivative(third, carried(dq, u3, du3), middle);

      const Velocity& v3 = third.v;
      const Velocity u4 = h * v3;
      VelocityMap fourth = map(q.step(u4), end);
      if (!fourth.regular) return end;
      Sensitivity du4 = h * d3;
      stretch(du4, u4);
      const Sensitivity d4 = derivative(fourth, carried(dq, u4, du4), end);

      const Velocity& v4 = fourth.v;
      Velocity u = h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
      add_bracket(u, h * h / 12, v1, v4);
      Sensitivity du = h / 6 * (d1 + 2 * d2 + 2 * d3 + d4);
      add_bracket_derivative(du, h * h / 12, v1, d1, v4, d4);
      stretch(du, u);
      stretch(du, bracket(h * h / 12, v1, v4));

      // The errors of both stages half-way cancel in their mean.
      const Velocity half = (u2 + u3) / 2;
      const Sensitivity d_half = (du2 + du3) / 2;
      q.step(half).write(to.q_half_way + i * (size + 1));
      rows(to.dq_half_way, i, size) = carried(dq, half, d_half);
      q = q.step(u);
      dq = carried(dq, u, du);
    }
    return kRegular;
  }

 private:
  double s(int half_step) const { return half_step / (2.0 * (points_ - 1)); }
  double time(int half_step) const { return s(half_step) * polynomial_.duration; }

  VelocityMap map(const Configuration& q, int half_step) const {
    return VelocityMap(chain_, q, momentum_, polynomial_.twist(coefficients_, s(half_step)),
                       null_space_.at(time(half_step)), damping_);
  }

  // Of a stage's velocity by the coefficients.
  Sensitivity derivative(VelocityMap& at, const Sensitivity& dq, int half_step) const {
    at.prepare_derivative();
    const Twists<columns> of_twist =
        polynomial_.template twist_derivative<columns>(coefficients_, s(half_step));
    Sensitivity dv = at.along(dq, of_twist);
    if constexpr (kFreeDuration)
      dv.col(kParameters) +=
          at.along_bias(null_space_.by_duration(time(half_step), polynomial_.duration));
    return dv;
  }

  // A tangent step, or a part of one, grows with the duration by its part of it.
  void stretch(Sensitivity& du, const Velocity& u) const {
    if constexpr (kFreeDuration) du.col(kParameters) += u / polynomial_.duration;
  }
  static Velocity bracket(double weight, const Velocity& a, const Velocity& b) {
    Velocity step = Velocity::Zero(a.size());
    if constexpr (kFreeDuration) add_bracket(step, weight, a, b);
    return step;
  }

  void write_point(const RolloutArrays& to, int i, const Configuration& q, const Sensitivity& dq,
                   const VelocityMap& at, const Sensitivity& dv) const {
    const Eigen::Index size = at.v.size();
    q.write(to.q + i * (size + 1));
    Eigen::Map<Velocity>(to.v + i * size, size) = at.v;
    rows(to.dq, i, size) = dq;
    rows(to.dv, i, size) = dv;
    // dv/dt follows q at the rate v, the twist at the acceleration, and z at its own rate.
    const Along<1> flow = at.v;
    const Twists<1> twist_rate = polynomial_.acceleration(coefficients_, s(2 * i));
    Eigen::Map<Velocity>(to.acceleration + i * size, size) =
        at.along(flow, twist_rate) + at.along_bias(null_space_.rate(time(2 * i)));
  }

  using Rows = Eigen::Matrix<double, Eigen::Dynamic, columns, Eigen::RowMajor>;
  static Eigen::Map<Rows> rows(double* of, int i, Eigen::Index size) {
    return {of + i * size * columns, size, columns};
  }

  const Chain& chain_;
  Vector6 momentum_;
  EndEffectorPolynomial polynomial_;
  NullSpaceFade null_space_;
  Coefficients coefficients_;
  int points_;
  double damping_;
};

}  // namespace ff
