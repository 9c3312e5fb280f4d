#include "motion/end_effector_rollout.hpp"

#include "kinematics/deadline.hpp"
#include "kinematics/velocity_map.hpp"
#include "motion/runge_kutta.hpp"

namespace ff {
namespace {

// SE(3) and the joints, and how tangent steps change by the coefficients, and by the duration if it
// is one more column.
template <int columns>
struct Configurations {
  using Sensitivity = Along<columns>;
  static constexpr bool kFreeDuration = columns > kParameters;

  double duration;

  static void add_bracket(Velocity& u, double weight, const Velocity& a, const Velocity& b) {
    u.head<6>() += weight * cross_motion(a.head<6>(), b.head<6>());
  }
  static void add_bracket_derivative(Sensitivity& du, double weight, const Velocity& a,
                                     const Sensitivity& da, const Velocity& b,
                                     const Sensitivity& db) {
    const Matrix6 ad_a = weight * cross_motion_matrix(a.head<6>());
    const Matrix6 ad_b = weight * cross_motion_matrix(b.head<6>());
    add_product(du.template topRows<6>(), ad_a, db.template topRows<6>());
    add_product(du.template topRows<6>(), ad_b, da.template topRows<6>(), -1);
  }
  void stretch(Sensitivity& du, const Velocity& u) const {
    if constexpr (kFreeDuration) du.col(kParameters) += u / duration;
  }
  void stretch(Sensitivity& du, const Velocity& u, double weight, const Velocity& a,
               const Velocity& b) const {
    if constexpr (kFreeDuration) {
      stretch(du, u);
      Velocity bracket = Velocity::Zero(u.size());
      add_bracket(bracket, weight, a, b);
      stretch(du, bracket);
    }
  }
  // Derivative of where the step `u` leads, of those of its beginning and of the step.
  static Sensitivity carried(const Sensitivity& dq, const Velocity& u, const Sensitivity& du) {
    const Vector6 of_base = u.head<6>();
    Sensitivity result = dq + du;  // of the joints
    auto base = result.template topRows<6>();
    base.setZero();
    add_product(base, exponential(of_base).motion_to_inner(), dq.template topRows<6>());
    add_product(base, exponential_derivative(of_base), du.template topRows<6>());
    return result;
  }
};

// columns: the coefficients, and the duration if it is one more.
template <int columns>
class Rollout {
 public:
  Rollout(const EndEffectorRollout& of, const Coefficients& coefficients)
      : chain_(of.chain),
        start_(of.start),
        momentum_(of.momentum),
        polynomial_(of.polynomial),
        null_space_(of.null_space),
        coefficients_(coefficients),
        points_(of.points),
        damping_(of.damping) {}

  int run(RolloutArrays to) const {
    Configuration q = start_;
    const int size = 6 + chain_.joints();
    const double h = polynomial_.duration / (points_ - 1);
    const Group group{polynomial_.duration};
    Sensitivity dq = Sensitivity::Zero(size, columns);
    Stages<Velocity> v, u;  // of the velocities and of the tangent steps, and their derivatives
    Stages<Sensitivity> dv, du;
    Wanted wanted = wanted_at(0);
    for (int i = 0; i < points_; ++i) {
      Deadline::require();
      Configuration at = q;
      Sensitivity d_at = dq;
      for (int stage = 0; stage < 4; ++stage) {
        const int half_step = 2 * i + kHalfSteps[stage];
        if (stage % 2 == 1) wanted = wanted_at(half_step);  // others lie where the one before does
        const VelocityMap map(chain_, at, momentum_, wanted.twist, null_space_.at(time(half_step)),
                              damping_);
        if (!map.regular) return half_step;
        const VelocityDerivative derivative(map);
        v[stage] = map.v;
        dv[stage] = along(derivative, d_at, wanted.by_x, half_step);
        if (stage == 0) {
          at.write(to.q.row(i));
          to.v.row(i) = v[0];
          to.dq.middleRows(i * size, size) = dq;
          to.dv.middleRows(i * size, size) = dv[0];
          to.acceleration.row(i) = acceleration(derivative, v[0], half_step);
          if (i == points_ - 1) break;
        }
        u[stage] = tangent_step<Group>(stage, h, v);
        du[stage] = tangent_step_derivative(group, stage, h, v, u[stage], dv);
        at = q.step(u[stage]);
        d_at = Group::carried(dq, u[stage], du[stage]);
      }
      if (i == points_ - 1) break;
      const Velocity half = half_way(u);
      q.step(half).write(to.q_half_way.row(i));
      to.dq_half_way.middleRows(i * size, size) = Group::carried(dq, half, half_way(du));
      q = at;
      dq = d_at;
    }
    return kRegular;
  }

 private:
  using Group = Configurations<columns>;
  using Sensitivity = typename Group::Sensitivity;

  // What the polynomial wants of the end effector.
  struct Wanted {
    Vector6 twist;
    Twists<columns> by_x;
  };
  Wanted wanted_at(int half_step) const {
    return {polynomial_.twist(coefficients_, s(half_step)),
            polynomial_.template twist_derivative<columns>(coefficients_, s(half_step))};
  }

  double s(int half_step) const { return half_step / (2.0 * (points_ - 1)); }
  double time(int half_step) const { return s(half_step) * polynomial_.duration; }

  // Of a stage's velocity by the coefficients.
  Sensitivity along(const VelocityDerivative& of, const Sensitivity& dq,
                    const Twists<columns>& dtwist, int half_step) const {
    Sensitivity dv = of.along(dq, dtwist);
    if constexpr (Group::kFreeDuration)
      dv.col(kParameters) +=
          of.along_bias(null_space_.by_duration(time(half_step), polynomial_.duration));
    return dv;
  }

  // dv/dt follows q at the rate v, the twist at the acceleration, and z at its own rate.
  Velocity acceleration(const VelocityDerivative& of, const Velocity& v, int half_step) const {
    const Along<1> flow = v;
    const Twists<1> twist_rate = polynomial_.acceleration(coefficients_, s(half_step));
    return of.along(flow, twist_rate) + of.along_bias(null_space_.rate(time(half_step)));
  }

  const Chain& chain_;
  const Configuration& start_;
  const Vector6& momentum_;
  const EndEffectorPolynomial& polynomial_;
  const NullSpaceFade& null_space_;
  const Coefficients& coefficients_;
  int points_;
  double damping_;
};

}  // namespace

int EndEffectorRollout::run(const Coefficients& coefficients, RolloutArrays to) const {
  if (polynomial.quintic_by_duration) return Rollout<kParameters + 1>(*this, coefficients).run(to);
  return Rollout<kParameters>(*this, coefficients).run(to);
}

}  // namespace ff
