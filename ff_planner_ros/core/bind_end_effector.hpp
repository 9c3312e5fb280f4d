// Python's way to the motions of the paper's family.
#pragma once
#include "arrays.hpp"
#include "end_effector_rollout.hpp"

namespace ff {

inline EndEffectorPolynomial end_effector_polynomial(double duration, const Array& quintic,
                                                     const Array& rotation_outer) {
  if (!(checked(duration, "duration") > 0))
    throw std::invalid_argument("duration must be positive");
  return {duration,
          Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(
              checked(quintic, "quintic", {6, 6})),
          matrix3(checked(rotation_outer, "rotation_outer", {3, 3}))};
}

inline Coefficients coefficients(const Array& x) {
  return Eigen::Map<const Coefficients>(checked(x, "x", {kParameters}));
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
      start, {q.mutable_data(), v.mutable_data(), q_half_way.mutable_data(), dq.mutable_data(),
              dv.mutable_data(), dq_half_way.mutable_data(), acceleration.mutable_data()});
  if (singular != kRegular) return py::float_(singular / (2.0 * gaps) * duration);
  return py::make_tuple(result(q, "q"), result(v, "v"), result(q_half_way, "q_half_way"),
                        result(dq, "dq"), result(dv, "dv"), result(dq_half_way, "dq_half_way"),
                        result(acceleration, "acceleration"));
}

// Returns the time of a dynamic singularity, or a tuple: q, v, q half-way; the derivatives of all
// three; dv/dt.
inline py::object end_effector_motion(const Chain& chain, const Array& q_start,
                                      const Array& momentum, double duration, const Array& quintic,
                                      const Array& rotation_outer, const Array& null_space,
                                      double fading, const Array& x, int points, double damping,
                                      const Array& quintic_by_duration) {
  const py::ssize_t n = chain.joints();
  if (points < 2) throw std::invalid_argument("points must be 2 or more");
  if (!(checked(fading, "fading") > 0)) throw std::invalid_argument("fading must be positive");
  const double* of_start = checked(null_space, "null_space", {2, n});
  const NullSpaceFade fade{Eigen::Map<const Joints>(of_start, n),
                           Eigen::Map<const Joints>(of_start + n, n), fading};
  const Vector6 conserved = vector6(checked(momentum, "momentum", {6}));
  EndEffectorPolynomial path = end_effector_polynomial(duration, quintic, rotation_outer);
  const Configuration start =
      Configuration::read(checked(q_start, "q_start", {7 + n}), static_cast<int>(n));
  const Coefficients of_x = coefficients(x);
  checked(damping, "damping");
  if (quintic_by_duration.size() == 0) {
    const EndEffectorRollout<kParameters> rollout(chain, conserved, path, fade, of_x, points,
                                                  damping);
    return rolled_out(rollout, start, points, duration);
  }
  path.quintic_by_duration = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(
      checked(quintic_by_duration, "quintic_by_duration", {6, 6}));
  const EndEffectorRollout<kParameters + 1> rollout(chain, conserved, path, fade, of_x, points,
                                                    damping);
  return rolled_out(rollout, start, points, duration);
}

// Returns twists, accelerations and d twist / d x at some normalised times.
inline py::tuple end_effector_twist(double duration, const Array& quintic,
                                    const Array& rotation_outer, const Array& x, const Array& s) {
  const EndEffectorPolynomial polynomial =
      end_effector_polynomial(duration, quintic, rotation_outer);
  const Coefficients of_x = coefficients(x);
  const double* times = checked(s, "s", {kAny});
  const py::ssize_t count = s.shape(0), parameters = kParameters;
  Array twist({count, py::ssize_t{6}}), acceleration({count, py::ssize_t{6}});
  Array by_x({count, py::ssize_t{6}, parameters});
  for (py::ssize_t i = 0; i < count; ++i) {
    Eigen::Map<Vector6>{twist.mutable_data() + 6 * i} = polynomial.twist(of_x, times[i]);
    Eigen::Map<Vector6>{acceleration.mutable_data() + 6 * i} =
        polynomial.acceleration(of_x, times[i]);
    Eigen::Map<Twists<kParameters>>{by_x.mutable_data() + 6 * kParameters* i} =
        polynomial.twist_derivative(of_x, times[i]);
  }
  return py::make_tuple(result(twist, "twist"), result(acceleration, "acceleration"),
                        result(by_x, "d twist / dx"));
}

inline void bind_end_effector(py::module_& m) {
  m.def("end_effector_motion", &end_effector_motion, py::arg("chain"), py::arg("q_start"),
        py::arg("momentum"), py::arg("duration"), py::arg("quintic"), py::arg("rotation_outer"),
        py::arg("null_space"), py::arg("fading"), py::arg("x"), py::arg("points"),
        py::arg("damping"), py::arg("quintic_by_duration") = Array(0));
  m.def("end_effector_twist", &end_effector_twist, py::arg("duration"), py::arg("quintic"),
        py::arg("rotation_outer"), py::arg("x"), py::arg("s"));
}

}  // namespace ff
