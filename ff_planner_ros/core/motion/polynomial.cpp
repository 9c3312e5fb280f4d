#include "motion/polynomial.hpp"

namespace ff {

Derivatives<FreeTerms> free_terms(double s) {
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

Matrix3 euler_rate_map(const Vector3& euler) {
  const double sy = std::sin(euler.y()), cy = std::cos(euler.y());
  const double sz = std::sin(euler.z()), cz = std::cos(euler.z());
  return (Matrix3() << cz * cy, -sz, 0, sz * cy, cz, 0, -sy, 0, 1).finished();
}

Matrix3 euler_rate_map_derivative(const Vector3& euler, const Vector3& rate) {
  const double sy = std::sin(euler.y()), cy = std::cos(euler.y());
  const double sz = std::sin(euler.z()), cz = std::cos(euler.z());
  const double phi = rate.x(), theta = rate.y();
  return (Matrix3() << 0, -cz * sy * phi, -sz * cy * phi - cz * theta,  //
          0, -sz * sy * phi, cz * cy * phi - sz * theta,                //
          0, -cy * phi, 0)
      .finished();
}

Derivatives<Vector6> EndEffectorPolynomial::components(const Coefficients& coefficients,
                                                       double s) const {
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

Vector6 EndEffectorPolynomial::twist(const Coefficients& coefficients, double s) const {
  const Derivatives<Vector6> of = components(coefficients, s);
  const Matrix3 W = euler_rate_map(of.value.tail<3>());
  return stack(of.rate.head<3>(), rotation_outer * (W * of.rate.tail<3>()));
}

Vector6 EndEffectorPolynomial::acceleration(const Coefficients& coefficients, double s) const {
  const Derivatives<Vector6> of = components(coefficients, s);
  const Vector3 euler = of.value.tail<3>(), euler_rate = of.rate.tail<3>();
  const Matrix3 W = euler_rate_map(euler), dW = euler_rate_map_derivative(euler, euler_rate);
  return stack(of.acceleration.head<3>(),
               rotation_outer * (W * of.acceleration.tail<3>() + dW * euler_rate));
}

Joints NullSpaceFade::at(double time) const {
  const double u = std::min(time / seconds, 1.0), u3 = u * u * u;
  const double f = 1 - u3 * (10 - u * (15 - 6 * u));
  const double g = u - u3 * (6 - u * (8 - 3 * u));
  return f * rates + seconds * g * accelerations;
}

Joints NullSpaceFade::by_duration(double time, double duration) const {
  const double u = std::min(time / seconds, 1.0), u3 = u * u * u;
  const double g = u - u3 * (6 - u * (8 - 3 * u));
  return seconds / duration * g * accelerations;
}

Joints NullSpaceFade::rate(double time) const {
  const double u = std::min(time / seconds, 1.0), u2 = u * u;
  const double f_slope = -30 * u2 * (1 - u) * (1 - u) / seconds;
  const double g_slope = 1 - u2 * (18 - u * (32 - 15 * u));
  return f_slope * rates + g_slope * accelerations;
}

}  // namespace ff
