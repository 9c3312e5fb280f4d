// Python's way to the solver of a search, and to its quadratic subproblems.
#include <pybind11/typing.h>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "optimisation/trust_region.hpp"
#include "program/evaluated_path.hpp"

namespace ff {
namespace {

// Functions that look at what an object of Python keeps: a path that the core evaluated, or the
// arrays of a Linearisation.
struct Linearised : Functions {
  py::object from;
  std::vector<Array> arrays;
};

double number(const py::object& from, const char* name) {
  py::detail::make_caster<double> found;
  if (!found.load(from.attr(name), true)) throw py::type_error(std::string(name) + " is no number");
  return checked(found, name);
}

std::shared_ptr<const Linearised> linearised(const py::object& from, py::ssize_t n = kAny) {
  if (py::isinstance<EvaluatedPath>(from)) {
    const auto& path = from.cast<const EvaluatedPath&>();
    if (n != kAny && path.motion.x.size() != n)
      throw std::invalid_argument("the path has " + std::to_string(path.motion.x.size()) +
                                  " variables, not " + std::to_string(n));
    return std::make_shared<Linearised>(Linearised{path.functions(), from, {}});
  }
  const Values none(nullptr, 0);
  const Rows no_rows(nullptr, 0, 0);
  if (!from.attr("is_defined").cast<bool>())
    return std::make_shared<Linearised>(Linearised{
        {0, none, no_rows, none, no_rows, none, no_rows, none, no_rows, {}, false}, from, {}});
  std::vector<Array> arrays;
  const auto array = [&](const char* name) -> const Array& {
    arrays.push_back(Array::ensure(from.attr(name)));
    if (!arrays.back()) throw py::type_error(std::string(name) + " is no array of numbers");
    return arrays.back();
  };
  const auto numbers = [&](const char* name) { return values(array(name), name, {kAny}); };
  const Values gradient = values(array("gradient"), "gradient", {n});
  n = gradient.size();
  const auto by_x = [&](const char* name, py::ssize_t count) {
    return rows(array(name), name, {count, n});
  };
  const Values max_terms = numbers("max_terms"), constraints = numbers("constraints"),
               equalities = numbers("equalities");
  const Numbers names = Numbers::ensure(from.attr("names"));
  if (!names) throw py::type_error("names is no array of integers");
  if (names.size() > 0) require_shape(names, "names", {constraints.size()});
  return std::make_shared<Linearised>(Linearised{
      {number(from, "value"),
       gradient,
       by_x("hessian", n),
       max_terms,
       by_x("max_terms_jacobian", max_terms.size()),
       constraints,
       by_x("constraints_jacobian", constraints.size()),
       equalities,
       equalities.size() > 0 ? by_x("equalities_jacobian", equalities.size()) : Rows(nullptr, 0, n),
       {names.data(), names.data() + names.size()}},
      from,
      std::move(arrays)});
}

Array array_of(const Eigen::VectorXd& numbers, const char* name) {
  return result(Array(numbers.size(), numbers.data()), name);
}

py::tuple step(const py::object& at_x, double radius, double penalty, double inside,
               const std::optional<WorkingSet>& guess) {
  const Step found =
      solve_subproblem(*linearised(at_x), checked(radius, "radius"), checked(penalty, "penalty"),
                       checked(inside, "inside"), guess, false);
  return py::make_tuple(
      array_of(found.dx, "dx"), result(found.objective, "objective"),
      result(found.violation, "violation"), array_of(found.on_constraints, "on_constraints"),
      array_of(found.on_equalities, "on_equalities"), array_of(found.on_max_terms, "on_max_terms"),
      result(found.optimality, "optimality"), found.working_set, found.is_elastic);
}

const char* word(Stop stop) {
  switch (stop) {
    case Stop::kUndefined:
      return "undefined";
    case Stop::kOptimality:
      return "optimality";
    case Stop::kProgress:
      return "progress";
    case Stop::kCreeping:
      return "creeping";
    case Stop::kStuck:
      return "stuck";
    case Stop::kStalled:
      return "stalled";
    case Stop::kIterations:
      break;
  }
  return "iterations";
}

py::tuple minimise(const py::typing::Callable<py::object(Array)>& linearise, const Array& start,
                   const py::object& at_start, const Array& curvature, double radius,
                   int iterations, double tolerance, double progress, double tolerated,
                   double feasibility, double inside) {
  const py::ssize_t n = start.size();
  const auto at = [&](const Eigen::VectorXd& x) -> FunctionsAt {
    return linearised(linearise(array_of(x, "x")), n);
  };
  const Place from = {values(start, "start", {n}), linearised(at_start, n),
                      rows(curvature, "curvature", {n, n}), checked(radius, "radius")};
  const Options options = {iterations,
                           checked(tolerance, "tolerance"),
                           checked(progress, "progress"),
                           checked(tolerated, "tolerated"),
                           checked(feasibility, "feasibility"),
                           checked(inside, "inside")};
  const Solution found = TrustRegionSolver(at, from, options).minimise();
  return py::make_tuple(array_of(found.end.x, "x"),
                        static_cast<const Linearised&>(*found.end.at_x).from,
                        result(found.end.curvature, "curvature"), found.end.radius,
                        found.iterations, word(found.stop), found.converged, found.optimality);
}

}  // namespace

void bind_optimisation(py::module_& m) {
  py::class_<WorkingSet>(m, "WorkingSet");
  m.def("solve_subproblem", &step, py::arg("at_x"), py::arg("radius"), py::arg("penalty"),
        py::arg("inside"), py::arg("guess"));
  m.def("minimise", &minimise, py::arg("linearise"), py::arg("start"), py::arg("at_start"),
        py::arg("curvature"), py::arg("radius"), py::arg("iterations"), py::arg("tolerance"),
        py::arg("progress"), py::arg("tolerated"), py::arg("feasibility"), py::arg("inside"));
}

}  // namespace ff

// The module `ff_planner_ros.core.compiled`; its types for Python are in compiled.pyi.
PYBIND11_MODULE(compiled, m) {
  m.doc() = "Numerics of the search, compiled.";
  m.attr("SOURCES_DIGEST") = pybind11::str(kSourcesDigest);
  ff::bind_kinematics(m);
  ff::bind_motion(m);
  ff::bind_collision(m);
  ff::bind_requirements(m);
  ff::bind_program(m);
  ff::bind_optimisation(m);
}
