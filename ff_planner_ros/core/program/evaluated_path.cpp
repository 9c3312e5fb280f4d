#include "program/evaluated_path.hpp"

namespace ff {

void ConstraintRows::add(double value, long long name, const Eigen::RowVectorXd& by_x) {
  values.push_back(value);
  names.push_back(name);
  jacobian.insert(jacobian.end(), by_x.data(), by_x.data() + by_x.size());
}

Functions EvaluatedPath::functions() const {
  const auto count = static_cast<Eigen::Index>(rows.values.size());
  return {terms.value,
          view(terms.gradient),
          view(terms.hessian),
          view(terms.max_terms),
          view(terms.max_terms_jacobian),
          {rows.values.data(), count},
          {rows.jacobian.data(), count, motion.variables()},
          view(motion.goal_error),
          view(motion.goal_error_by_x),
          rows.names,
          is_defined()};
}

}  // namespace ff
