#include "kinematics/cholesky.hpp"

namespace ff {

Eigen::LLT<Matrix6> cholesky(const Matrix6& matrix) { return Eigen::LLT<Matrix6>(matrix); }

Vector6 solved(const Eigen::LLT<Matrix6>& factors, const Vector6& right) {
  return factors.solve(right);
}

Matrix6 solved(const Eigen::LLT<Matrix6>& factors, const Matrix6& right) {
  return factors.solve(right);
}

Eigen::LLT<Eigen::MatrixXd> cholesky(const Eigen::MatrixXd& matrix) {
  return Eigen::LLT<Eigen::MatrixXd>(matrix);
}

Eigen::VectorXd solved(const Eigen::LLT<Eigen::MatrixXd>& factors, const Eigen::VectorXd& right) {
  return factors.solve(right);
}

RowMajor solved(const Eigen::LLT<Eigen::MatrixXd>& factors, const RowMajor& right) {
  return factors.solve(right);
}

}  // namespace ff
