// What a solver takes of orthogonal decompositions, each compiled once: Eigen's take the compiler
// longer than the solver itself.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

// A symmetric matrix without its negative eigenvalues.
RowMajor semidefinite_part(const Eigen::MatrixXd& symmetric);

// The shortest of the solutions of a system that has many.
Eigen::VectorXd shortest_solution(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right);

}  // namespace ff
