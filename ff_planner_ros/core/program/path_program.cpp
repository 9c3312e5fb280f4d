#include "program/path_program.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

void Correction::apply(PathMotion& to) const {
  for (Eigen::Index i = 0; i < q.rows(); ++i)
    Configuration::read(to.q.row(i)).step(q.row(i)).write(to.q.row(i));
  to.v += v;
}

EvaluatedPath PathProgram::at(const Eigen::VectorXd& x) {
  EvaluatedPath found{paths_->motion(x, by_x_), {}, {}};
  if (!found.is_defined()) return found;
  PathMotion& motion = found.motion;
  found.terms = objective_.terms(paths_->chain(), motion, by_x_, step_);
  if (!correction_) {
    found.rows = rows_of(motion);
    return found;
  }
  const RowMajor q = motion.q, v = motion.v;
  correction_->apply(motion);
  found.rows = rows_of(motion);
  motion.q = q;
  motion.v = v;
  return found;
}

ConstraintRows PathProgram::rows_of(const PathMotion& motion) const {
  const LookedAt at(paths_->chain(), motion, by_x_, step_);
  ConstraintRows all;
  for (const Numbered& of : requirements_) {
    Deadline::require();
    const ConstraintRows found = of.requirement->rows(at);
    all.values.insert(all.values.end(), found.values.begin(), found.values.end());
    all.jacobian.insert(all.jacobian.end(), found.jacobian.begin(), found.jacobian.end());
    for (const long long name : found.names)
      all.names.push_back(name + of.number * kNames + kNames / 2);
  }
  return all;
}

}  // namespace ff
