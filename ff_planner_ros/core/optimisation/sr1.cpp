#include "optimisation/sr1.hpp"

namespace ff {

void sr1_update(RowMajor& curvature, const Functions& at_x, const Functions& at_trial,
                const Eigen::VectorXd& dx, const Eigen::VectorXd& on_max_terms,
                const Eigen::VectorXd& on_constraints) {
  if (at_x.max_terms.size() == 0) return;
  Eigen::VectorXd residual =
      (at_trial.max_terms_jacobian - at_x.max_terms_jacobian).transpose() * on_max_terms;
  for (size_t row = 0; row < at_x.names.size(); ++row) {
    if (on_constraints[row] == 0) continue;
    const auto& others = at_trial.names;
    const auto other = std::find(others.begin(), others.end(), at_x.names[row]);
    if (other == others.end()) continue;
    residual -= on_constraints[row] * (at_trial.constraints_jacobian.row(other - others.begin()) -
                                       at_x.constraints_jacobian.row(row));
  }
  residual -= curvature * dx;
  const double along = residual.dot(dx);
  if (std::abs(along) > kOrthogonal * residual.norm() * dx.norm())
    curvature += residual * residual.transpose() / along;
}

}  // namespace ff
