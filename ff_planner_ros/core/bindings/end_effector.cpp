// Python's way to the motions of the paper's family.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "program/end_effector_paths.hpp"

namespace ff {
namespace {

EndEffectorPolynomial end_effector_polynomial(double duration, const Array& quintic,
                                              const Array& rotation_outer,
                                              const Array& quintic_by_duration) {
  if (!(checked(duration, "duration") > 0))
    throw std::invalid_argument("duration must be positive");
  EndEffectorPolynomial path{duration, rows(quintic, "quintic", {6, 6}),
                             matrix3(rotation_outer, "rotation_outer")};
  if (quintic_by_duration.size() > 0)
    path.quintic_by_duration = rows(quintic_by_duration, "quintic_by_duration", {6, 6});
  return path;
}

NullSpaceFade null_space_fade(const Array& rates, const Array& accelerations, double seconds) {
  if (!(checked(seconds, "seconds") > 0)) throw std::invalid_argument("seconds must be positive");
  const py::ssize_t joints = rates.ndim() > 0 ? rates.shape(0) : 0;
  if (joints > kMaxJoints) throw std::invalid_argument("rates has the shape " + written({joints}));
  return {values(rates, "rates", {joints}), values(accelerations, "accelerations", {joints}),
          seconds};
}

Coefficients coefficients(const Array& x) {
  return Eigen::Map<const Coefficients>(values(x, "x", {kParameters}).data());
}

template <int columns>
py::object rolled_out(const EndEffectorRollout<columns>& rollout, const Configuration& start,
                      int points, double duration) {
  const py::ssize_t size = 6 + start.joints.size(), variables = columns;
  const py::ssize_t rows = points, gaps = points - 1;
  Array q({rows, 1 + size}), v({rows, size}), q_half_way({gaps, 1 + size});
  Array dq({rows, size, variables}), dv({rows, size, variables});
  Array dq_half_way({gaps, size, variables}), acceleration({rows, size});
  const int singular = rollout.run(
      start, {rows_to_fill(q), rows_to_fill(v), rows_to_fill(q_half_way), rows_to_fill(dq),
              rows_to_fill(dv), rows_to_fill(dq_half_way), rows_to_fill(acceleration)});
  if (singular != kRegular) return py::float_(singular / (2.0 * gaps) * duration);
  return py::make_tuple(result(q, "q"), result(v, "v"), result(q_half_way, "q_half_way"),
                        result(dq, "dq"), result(dv, "dv"), result(dq_half_way, "dq_half_way"),
                        result(acceleration, "acceleration"));
}

// Returns the time of a dynamic singularity, or a tuple: q, v, q half-way; the derivatives of all
// three; dv/dt.
py::object end_effector_motion(const Chain& chain, const Array& q_start, const Array& momentum,
                               const EndEffectorPolynomial& path, const NullSpaceFade& null_space,
                               const Array& x, int points, double damping) {
  const py::ssize_t n = chain.joints();
  if (points < 2) throw std::invalid_argument("points must be 2 or more");
  if (null_space.rates.size() != n) throw std::invalid_argument("null_space is of another chain");
  const Configuration start = Configuration::read(values(q_start, "q_start", {7 + n}));
  const Vector6 conserved = vector6(momentum, "momentum");
  const auto motion = [&](auto columns) {
    const EndEffectorRollout<columns()> rollout(chain, conserved, path, null_space, coefficients(x),
                                                points, checked(damping, "damping"));
    return rolled_out(rollout, start, points, path.duration);
  };
  if (path.quintic_by_duration) return motion(std::integral_constant<int, kParameters + 1>());
  return motion(std::integral_constant<int, kParameters>());
}

std::shared_ptr<PathsOnGrid> end_effector_paths(const Chain& chain, const Array& q_start,
                                                const Array& momentum,
                                                const EndEffectorPolynomial& path,
                                                const NullSpaceFade& null_space, int points,
                                                double damping, const Array& goal_by_duration) {
  const py::ssize_t n = chain.joints();
  if (points < 2) throw std::invalid_argument("points must be 2 or more");
  if (null_space.rates.size() != n) throw std::invalid_argument("null_space is of another chain");
  std::optional<Vector6> goal_moves;
  if (goal_by_duration.size() > 0) goal_moves = vector6(goal_by_duration, "goal_by_duration");
  if (path.quintic_by_duration.has_value() != goal_moves.has_value())
    throw std::invalid_argument("path and goal must both move with the duration, or neither");
  return std::make_shared<EndEffectorPathsOnGrid>(
      chain, Configuration::read(values(q_start, "q_start", {7 + n})),
      vector6(momentum, "momentum"), path, null_space, points, checked(damping, "damping"),
      goal_moves);
}

// Returns twists, accelerations and d twist / d x at some normalised times.
py::tuple end_effector_twist(const EndEffectorPolynomial& path, const Array& x, const Array& s) {
  const Coefficients of_x = coefficients(x);
  const Values times = values(s, "s", {kAny});
  const py::ssize_t count = times.size(), six = 6, parameters = kParameters;
  Array twist({count, six}), acceleration({count, six}), by_x({count, six, parameters});
  RowsToFill of_twist = rows_to_fill(twist), of_acceleration = rows_to_fill(acceleration);
  RowsToFill of_derivative = rows_to_fill(by_x);
  for (py::ssize_t i = 0; i < count; ++i) {
    of_twist.row(i) = path.twist(of_x, times[i]);
    of_acceleration.row(i) = path.acceleration(of_x, times[i]);
    of_derivative.middleRows<6>(6 * i) = path.twist_derivative(of_x, times[i]);
  }
  return py::make_tuple(result(twist, "twist"), result(acceleration, "acceleration"),
                        result(by_x, "d twist / dx"));
}

}  // namespace

void bind_end_effector(py::module_& m) {
  py::class_<EndEffectorPolynomial>(m, "EndEffectorPolynomial")
      .def(py::init(&end_effector_polynomial), py::arg("duration"), py::arg("quintic"),
           py::arg("rotation_outer"), py::arg("quintic_by_duration") = Array(0));
  py::class_<NullSpaceFade>(m, "NullSpaceFade")
      .def(py::init(&null_space_fade), py::arg("rates"), py::arg("accelerations"),
           py::arg("seconds"));
  m.def("end_effector_motion", &end_effector_motion, py::arg("chain"), py::arg("q_start"),
        py::arg("momentum"), py::arg("path"), py::arg("null_space"), py::arg("x"),
        py::arg("points"), py::arg("damping"));
  m.def("end_effector_paths", &end_effector_paths, py::arg("chain"), py::arg("q_start"),
        py::arg("momentum"), py::arg("path"), py::arg("null_space"), py::arg("points"),
        py::arg("damping"), py::arg("goal_by_duration") = Array(0));
  m.def("end_effector_twist", &end_effector_twist, py::arg("path"), py::arg("x"), py::arg("s"));
}

}  // namespace ff
