// The end effector's path: quintic and three free terms for each of six components, Eqs. (33)-(42).
//
// In normalised time s = t / T the free terms are f_j = 64 s^3 (1 - s)^3 s^j. Components 3 to 5 are
// Euler angles, R = A Rz(psi) Ry(theta) Rx(phi) B.
#pragma once
#include <optional>

#include "kinematics/velocity_map.hpp"

namespace ff {

constexpr int kComponents = 6, kFreeTerms = 3, kParameters = kComponents * kFreeTerms;

using Coefficients = Eigen::Matrix<double, kComponents, kFreeTerms, Eigen::RowMajor>;
using FreeTerms = Eigen::Matrix<double, kFreeTerms, 1>;

// Values at one time, and derivatives with respect to s.
template <typename Vector>
struct Derivatives {
  Vector value, rate, acceleration;
};

Derivatives<FreeTerms> free_terms(double s);

// W with omega = A W euler_rate.
Matrix3 euler_rate_map(const Vector3& euler);

// d(W rate)/d euler at fixed rates.
Matrix3 euler_rate_map_derivative(const Vector3& euler, const Vector3& rate);

struct EndEffectorPolynomial {
  double duration;         // T
  Matrix6 quintic;         // ascending coefficients in s, a column a component
  Matrix3 rotation_outer;  // A
  // Of the quintic by the duration, start and goal being where they are then; where it is one more
  // variable
  std::optional<Matrix6> quintic_by_duration = {};

  // The six components and their derivatives with respect to time.
  Derivatives<Vector6> components(const Coefficients& coefficients, double s) const;

  // Linear and angular velocity, inertial axes.
  Vector6 twist(const Coefficients& coefficients, double s) const;

  // Linear and angular acceleration, inertial axes.
  Vector6 acceleration(const Coefficients& coefficients, double s) const;

  // d twist / d coefficients, these flattened; behind them that by the duration, if asked for. At a
  // fixed s the components change with the quintic, and their rates are 1 / T of those by s.
  template <int columns = kParameters>
  Twists<columns> twist_derivative(const Coefficients& coefficients, double s) const {
    const Derivatives<Vector6> of = components(coefficients, s);
    const Derivatives<FreeTerms> f = free_terms(s);
    const FreeTerms f_rate = f.rate / duration;
    const Vector3 euler = of.value.tail<3>(), euler_rate = of.rate.tail<3>();
    const Matrix3 W = rotation_outer * euler_rate_map(euler);
    const Matrix3 dW = rotation_outer * euler_rate_map_derivative(euler, euler_rate);
    Twists<columns> derivative = Twists<columns>::Zero();
    for (int k = 0; k < 3; ++k) {
      derivative.template block<1, kFreeTerms>(k, kFreeTerms * k) = f_rate.transpose();
      derivative.template block<3, kFreeTerms>(3, kFreeTerms * (3 + k)) =
          W.col(k) * f_rate.transpose() + dW.col(k) * f.value.transpose();
    }
    if constexpr (columns > kParameters) {
      Vector6 value = Vector6::Zero(), rate = value;
      for (int k = 5; k >= 0; --k) {
        rate = s * rate + value;
        value = s * value + quintic_by_duration->row(k).transpose();
      }
      rate = (rate - of.rate) / duration;
      derivative.col(kParameters) =
          stack(rate.head<3>(), W * rate.tail<3>() + dW * value.tail<3>());
    }
    return derivative;
  }
};

// Joint rates z(t) that begin with those of the start and fade smoothly until `seconds`.
struct NullSpaceFade {
  Joints rates, accelerations;  // z_0, z_0'
  double seconds;

  // z(t) = f(u) z_0 + d T g(u) z_0', u = t / (d T).
  Joints at(double time) const;
  // d z / d T at a fixed part of the duration T, of which `seconds` are a part.
  Joints by_duration(double time, double duration) const;
  Joints rate(double time) const;
};

}  // namespace ff
