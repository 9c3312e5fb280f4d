// A path with what a program says of it: its motion, objectives and rows of requirements.
#pragma once
#include "optimisation/subproblem.hpp"
#include "program/path_motion.hpp"

namespace ff {

inline Rows view(const RowMajor& of) { return {of.data(), of.rows(), of.cols()}; }
inline Values view(const Eigen::VectorXd& of) { return {of.data(), of.size()}; }

// The contribution of the objectives to a program: f, and the max terms p.
struct Terms {
  double value = 0;
  Eigen::VectorXd gradient, max_terms;
  RowMajor hessian, max_terms_jacobian;
};

// Rows of one requirement: values, derivatives and names.
struct ConstraintRows {
  std::vector<double> values, jacobian;  // a row of derivatives a value
  std::vector<long long> names;

  void add(double value, long long name, const Eigen::RowVectorXd& by_x);
};

// The functions look at what is kept beside them.
struct EvaluatedPath {
  PathMotion motion;
  Terms terms;
  ConstraintRows rows;

  bool is_defined() const { return motion.is_regular(); }
  Functions functions() const;
};

}  // namespace ff
