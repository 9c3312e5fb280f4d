// Cholesky factorisations and their solutions, each compiled once: Eigen's take the compiler longer
// than what uses them.
#pragma once
#include <Eigen/Cholesky>

#include "kinematics/chain.hpp"

namespace ff {

Eigen::LLT<Matrix6> cholesky(const Matrix6& matrix);
Vector6 solved(const Eigen::LLT<Matrix6>& factors, const Vector6& right);
Matrix6 solved(const Eigen::LLT<Matrix6>& factors, const Matrix6& right);

Eigen::LLT<Eigen::MatrixXd> cholesky(const Eigen::MatrixXd& matrix);
Eigen::VectorXd solved(const Eigen::LLT<Eigen::MatrixXd>& factors, const Eigen::VectorXd& right);
RowMajor solved(const Eigen::LLT<Eigen::MatrixXd>& factors, const RowMajor& right);

}  // namespace ff
