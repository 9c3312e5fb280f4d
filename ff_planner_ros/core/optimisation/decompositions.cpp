#include "optimisation/decompositions.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

namespace ff {

RowMajor semidefinite_part(const Eigen::MatrixXd& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> parts(symmetric);
  const auto& vectors = parts.eigenvectors();
  return vectors * parts.eigenvalues().cwiseMax(0).asDiagonal() * vectors.transpose();
}

Eigen::VectorXd shortest_solution(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right) {
  return matrix.completeOrthogonalDecomposition().solve(right);
}

}  // namespace ff
