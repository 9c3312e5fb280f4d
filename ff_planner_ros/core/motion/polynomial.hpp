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

inline Derivatives<FreeTerms> free_terms(double s) {
  const double r = 1 - s, bump = 64 * s * r;
  Derivatives<FreeTerms> f;
  double power = bump;  // 64 s^(1 + j) (1 - s)
  for (int j = 0; j < kFreeTerms; ++j, power *= s) {
    const double a = 3 + j;
    f.value[j] = power * s * s * r * r;
    f.rate[j] = power * s * r * (a * r - 3 * s);
    f.acceleration[j] = power * (a * (a - 1) * r * r - 6 * a * s * r + 6 * s * s);
  }
  return f;
}

// W with omega = A W euler_rate.
inline Matrix3 euler_rate_map(const Vector3& euler) {
  const double sy = std::sin(euler.y()), cy = std::cos(euler.y());
  const double sz = std::sin(euler.z()), cz = std::cos(euler.z());
  return (Matrix3() << cz * cy, -sz, 0, sz * cy, cz, 0, -sy, 0, 1).finished();
}

// d(W rate)/d euler at fixed rates.
inline Matrix3 euler_rate_map_derivative(const Vector3& euler, const Vector3& rate) {
  const double sy = std::sin(euler.y()), cy = std::cos(euler.y());
  const double sz = std::sin(euler.z()), cz = std::cos(euler.z());
  const double phi = rate.x(), theta = rate.y();
  return (Matrix3() << 0, -cz * sy * phi, -sz * cy * phi - cz * theta,  //
          0, -sz * sy * phi, cz * cy * phi - sz * theta,                //
          0, -cy * phi, 0)
      .finished();
}

struct EndEffectorPolynomial {
  double duration;         // T
  Matrix6 quintic;         // ascending coefficients in s, a column a component
  Matrix3 rotation_outer;  // A
  // Of the quintic by the duration, start and goal being where they are then; where it is one more
  // variable
  std::optional<Matrix6> quintic_by_duration = {};

  // The six components and their derivatives with respect to time.
  Derivatives<Vector6> components(const Coefficients& coefficients, double s) const {
    Vector6 value = Vector6::Zero(), rate = value, half_acceleration = value;
    for (int k = 5; k >= 0; --k) {  // Horner's scheme
      half_acceleration = s * half_acceleration + rate;
      rate = s * rate + value;
      value = s * value + quintic.row(k).transpose();
    }
    const Derivatives<FreeTerms> f = free_terms(s);
    return {value + coefficients * f.value, (rate + coefficients * f.rate) / duration,
            (2 * half_acceleration + coefficients * f.acceleration) / (duration * duration)};
  }

  // Linear and angular velocity, inertial axes.
  Vector6 twist(const Coefficients& coefficients, double s) const {
    const Derivatives<Vector6> of = components(coefficients, s);
    const Matrix3 W = euler_rate_map(of.value.tail<3>());
    return stack(of.rate.head<3>(), rotation_outer * (W * of.rate.tail<3>()));
  }

  // Linear and angular acceleration, inertial axes.
  Vector6 acceleration(const Coefficients& coefficients, double s) const {
    const Derivatives<Vector6> of = components(coefficients, s);
    const Vector3 euler = of.value.tail<3>(), euler_rate = of.rate.tail<3>();
    const Matrix3 W = euler_rate_map(euler), dW = euler_rate_map_derivative(euler, euler_rate);
    return stack(of.acceleration.head<3>(),
                 rotation_outer * (W * of.acceleration.tail<3>() + dW * euler_rate));
  }

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
  Joints at(double time) const {
    const double u = std::min(time / seconds, 1.0), u3 = u * u * u;
    const double f = 1 - u3 * (10 - u * (15 - 6 * u));
    const double g = u - u3 * (6 - u * (8 - 3 * u));
    return f * rates + seconds * g * accelerations;
  }
  // d z / d T at a fixed part of the duration T, of which `seconds` are a part.
  Joints by_duration(double time, double duration) const {
    const double u = std::min(time / seconds, 1.0), u3 = u * u * u;
    const double g = u - u3 * (6 - u * (8 - 3 * u));
    return seconds / duration * g * accelerations;
  }
  Joints rate(double time) const {
    const double u = std::min(time / seconds, 1.0), u2 = u * u;
    const double f_slope = -30 * u2 * (1 - u) * (1 - u) / seconds;
    const double g_slope = 1 - u2 * (18 - u * (32 - 15 * u));
    return f_slope * rates + g_slope * accelerations;
  }
};

}  // namespace ff
