// Python's way to the quadratic programs of a search.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "optimisation/dual_active_set.hpp"

namespace ff {
namespace {

// Returns whether there is a solution, and it with its multipliers; None: that is undecided.
py::object solve_program(const Array& hessian, const Array& gradient, const Array& equal_rows,
                         const Array& equal, const Array& by_x, const Array& least,
                         const Array& lower, const Array& upper, const Numbers& guess) {
  const py::ssize_t n = hessian.ndim() > 0 ? hessian.shape(0) : 0;
  const QuadraticProgram program{rows(hessian, "hessian", {n, n}),
                                 values(gradient, "gradient", {n}),
                                 rows(equal_rows, "equal_rows", {kAny, n}),
                                 values(equal, "equal", {equal_rows.shape(0)}),
                                 rows(by_x, "rows", {kAny, n}),
                                 values(least, "least", {by_x.shape(0)}),
                                 values(lower, "lower", {n}),
                                 values(upper, "upper", {n})};
  require_shape(guess, "guess", {kAny});
  const long long count = least.size() + 2 * n;
  std::vector<int> numbers;
  for (py::ssize_t i = 0; i < guess.size(); ++i) {
    if (guess.at(i) < 0 || guess.at(i) >= count)
      throw std::invalid_argument("guess has constraint " + std::to_string(guess.at(i)) +
                                  ", and there are " + std::to_string(count));
    numbers.push_back(guess.at(i));
  }
  DualActiveSet solver(program);
  const DualActiveSet::Outcome outcome = solver.solve(numbers);
  if (outcome == DualActiveSet::kUndecided) return py::none();
  if (outcome == DualActiveSet::kInfeasible) return py::bool_(false);
  const auto array = [](const Eigen::VectorXd& numbers, const char* name) {
    return result(Array(numbers.size(), numbers.data()), name);
  };
  return py::make_tuple(array(solver.x, "x"), array(solver.of_equalities, "of_equalities"),
                        array(solver.of_rows, "of_rows"), array(solver.of_bounds, "of_bounds"));
}

}  // namespace

void bind_quadratic_program(py::module_& m) {
  m.def("solve_program", &solve_program, py::arg("hessian"), py::arg("gradient"),
        py::arg("equal_rows"), py::arg("equal"), py::arg("rows"), py::arg("least"),
        py::arg("lower"), py::arg("upper"), py::arg("guess"));
}

}  // namespace ff
