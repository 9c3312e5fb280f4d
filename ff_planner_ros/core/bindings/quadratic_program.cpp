// Python's way to the quadratic subproblems of a search.
#include <pybind11/stl.h>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "optimisation/subproblem.hpp"

namespace ff {
namespace {

py::tuple step(double value, const Array& gradient, const Array& hessian, const Array& max_terms,
               const Array& max_terms_jacobian, const Array& constraints,
               const Array& constraints_jacobian, const Array& equalities,
               const Array& equalities_jacobian, const Numbers& names, double radius,
               double penalty, double inside, const std::optional<WorkingSet>& guess,
               bool elastic) {
  const py::ssize_t n = gradient.size();
  require_shape(names, "names", {constraints.size()});
  const Step found =
      solve_subproblem({checked(value, "value"),
                        values(gradient, "gradient", {n}),
                        rows(hessian, "hessian", {n, n}),
                        values(max_terms, "max_terms", {kAny}),
                        rows(max_terms_jacobian, "max_terms_jacobian", {max_terms.size(), n}),
                        values(constraints, "constraints", {kAny}),
                        rows(constraints_jacobian, "constraints_jacobian", {constraints.size(), n}),
                        values(equalities, "equalities", {kAny}),
                        rows(equalities_jacobian, "equalities_jacobian", {equalities.size(), n}),
                        {names.data(), names.data() + names.size()}},
                       checked(radius, "radius"), checked(penalty, "penalty"),
                       checked(inside, "inside"), guess, elastic);
  const auto array = [](const Eigen::VectorXd& numbers, const char* name) {
    return result(Array(numbers.size(), numbers.data()), name);
  };
  return py::make_tuple(
      array(found.dx, "dx"), result(found.objective, "objective"),
      result(found.violation, "violation"), array(found.on_constraints, "on_constraints"),
      array(found.on_equalities, "on_equalities"), array(found.on_max_terms, "on_max_terms"),
      result(found.optimality, "optimality"), found.working_set, found.is_elastic);
}

}  // namespace

void bind_quadratic_program(py::module_& m) {
  py::class_<WorkingSet>(m, "WorkingSet");
  m.def("solve_subproblem", &step, py::arg("value"), py::arg("gradient"), py::arg("hessian"),
        py::arg("max_terms"), py::arg("max_terms_jacobian"), py::arg("constraints"),
        py::arg("constraints_jacobian"), py::arg("equalities"), py::arg("equalities_jacobian"),
        py::arg("names"), py::arg("radius"), py::arg("penalty"), py::arg("inside"),
        py::arg("guess"), py::arg("elastic"));
}

}  // namespace ff
