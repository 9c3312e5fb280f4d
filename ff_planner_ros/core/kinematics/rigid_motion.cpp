#include "kinematics/rigid_motion.hpp"

namespace ff {

AngleFunctions::AngleFunctions(double square) {
  const double y = square;
  if (y < 0.01) {
    b = 1. / 2 - y * (1. / 24 - y * (1. / 720 - y * (1. / 40320 - y / 3628800)));
    c = 1. / 6 - y * (1. / 120 - y * (1. / 5040 - y * (1. / 362880 - y / 39916800)));
    b_rate = -1. / 12 + y * (1. / 180 - y * (1. / 6720 - y * (1. / 453600 - y / 47900160)));
    c_rate = -1. / 60 + y * (1. / 1260 - y * (1. / 60480 - y * (1. / 4989600 - y / 622702080)));
  } else {
    const double x = std::sqrt(y), sine = std::sin(x) / x;
    b = (1 - std::cos(x)) / y;
    c = (1 - sine) / y;
    b_rate = (sine - 2 * b) / y;
    c_rate = (b - 3 * c) / y;
  }
}

Pose exponential(const Vector6& step) {
  const Vector3 v = step.head<3>(), w = step.tail<3>();
  const AngleFunctions of(w.squaredNorm());
  const Matrix3 W = skew(w), W2 = skew_square(w);
  const double a = 1 - of.c * w.squaredNorm();  // sin(x) / x
  return {v + of.b * (W * v) + of.c * (W2 * v), Matrix3::Identity() + a * W + of.b * W2};
}

Matrix6 exponential_derivative(const Vector6& step) {
  const Vector3 v = step.head<3>(), w = step.tail<3>();
  const AngleFunctions of(w.squaredNorm());
  const Matrix3 W = skew(w), V = skew(v), W2 = skew_square(w), WV = W * V;
  Matrix6 derivative = Matrix6::Zero();
  derivative.topLeftCorner<3, 3>() = derivative.bottomRightCorner<3, 3>() =
      Matrix3::Identity() - of.b * W + of.c * W2;
  derivative.topRightCorner<3, 3>() =
      -of.b * V + of.c * (WV + WV.transpose()) + w.dot(v) * (of.c_rate * W2 - of.b_rate * W);
  return derivative;
}

Eigen::Quaterniond turn(const Vector6& step) {
  const Vector3 w = step.tail<3>();
  const double angle = w.norm();
  const double scale = angle > 1e-8 ? std::sin(angle / 2) / angle : 0.5;
  return {std::cos(angle / 2), scale * w.x(), scale * w.y(), scale * w.z()};
}

}  // namespace ff
