// The SR1 quasi-Newton approximation of the curvature of max terms and constraints.
#pragma once
#include <algorithm>

#include "optimisation/subproblem.hpp"

namespace ff {

// An SR1 update by a step that is so nearly orthogonal to it is rounding.
constexpr double kOrthogonal = 1e-8;

// Updates the curvature of max terms and constraints by one step. It approximates the Hessian of
// their sum, weighted by the step's multipliers. Without max terms it is unchanged: the
// Gauss-Newton Hessian of f is better alone.
void sr1_update(RowMajor& curvature, const Functions& at_x, const Functions& at_trial,
                const Eigen::VectorXd& dx, const Eigen::VectorXd& on_max_terms,
                const Eigen::VectorXd& on_constraints);

}  // namespace ff
