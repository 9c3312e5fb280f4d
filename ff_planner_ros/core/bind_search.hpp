// Python's way to the objectives and to the certificate of a search.
#pragma once
#include "bind_clearance.hpp"
#include "certificate.hpp"
#include "chaser_euler.hpp"
#include "joint_path.hpp"

namespace ff {

// Returns value, gradient and Hessian.
inline py::tuple joint_path(const Array& v, const Array& dv, double step, double slow,
                            double smoothing) {
  const double* of_v = checked(v, "v", {kAny, kAny});
  const py::ssize_t points = v.shape(0), size = v.shape(1);
  const double* of_dv = checked(dv, "by_x", {points, size, kAny});
  const py::ssize_t variables = dv.shape(2);
  if (points < 2 || size < 7 || size > kMaxVelocities)
    throw std::invalid_argument("v has the shape " + written({points, size}));
  const JointPath path(Eigen::Map<const RowMajor>(of_v, points, size), of_dv,
                       static_cast<int>(variables), checked(step, "step"), checked(slow, "slow"),
                       checked(smoothing, "smoothing"));
  return py::make_tuple(result(path.value, "value"),
                        result(Array(variables, path.gradient.data()), "gradient"),
                        result(path.hessian, "hessian"));
}

// Returns the angles and their derivatives.
inline py::tuple chaser_euler(const Array& q, const Array& dq, const Array& chaser_to_base) {
  const double* of_q = checked(q, "q", {kAny, kAny});
  const py::ssize_t points = q.shape(0), size = q.shape(1), three = 3;
  if (size < 8 || size > kMaxVelocities + 1)
    throw std::invalid_argument("q has the shape " + written({points, size}));
  const double* of_dq = checked(dq, "by_x", {points, size - 1, kAny});
  const py::ssize_t variables = dq.shape(2);
  const ChaserEuler found(
      Eigen::Map<const RowMajor>(of_q, points, size), of_dq, static_cast<int>(variables),
      matrix3(checked(chaser_to_base, "rotation_chaser_to_base", {three, three})));
  return py::make_tuple(result(found.angles, "angles"),
                        result(Array({points, three, variables}, found.jacobian.data()), "by_x"));
}

inline double certified(const Chain& chain, const Array& q, const Array& cubics, const Array& ways,
                        const Array& times, const Array& centers, const Array& velocities,
                        const Array& radii, double gap, const std::vector<Attached>& fixed) {
  const py::ssize_t n = chain.joints(), three = 3;
  const double* of_q = checked(q, "q", {kAny, 7 + n});
  const py::ssize_t points = q.shape(0), intervals = points - 1;
  if (points < 2) throw std::invalid_argument("q must hold two configurations or more");
  const double* of_cubics = checked(cubics, "cubics", {intervals, three, 6 + n});
  const std::vector<Sphere> all = moving_spheres(centers, velocities, radii, fixed);
  if (!(checked(gap, "gap") > 0)) throw std::invalid_argument("gap must be positive");
  std::vector<Configuration> at;
  for (py::ssize_t i = 0; i < points; ++i)
    at.push_back(Configuration::read(of_q + i * (7 + n), static_cast<int>(n)));
  if (all.empty()) return std::numeric_limits<double>::infinity();
  return certified_clearance(
      {chain, at, Eigen::Map<const RowMajor>(of_cubics, 3 * intervals, 6 + n),
       Eigen::Map<const Eigen::VectorXd>(checked(times, "times", {points}), points)},
      Eigen::Map<const Eigen::VectorXd>(checked(ways, "ways", {intervals}), intervals), all, gap);
}

inline void bind_search(py::module_& m) {
  m.def("joint_path", &joint_path, py::arg("v"), py::arg("by_x"), py::arg("step"), py::arg("slow"),
        py::arg("smoothing"));
  m.def("chaser_euler", &chaser_euler, py::arg("q"), py::arg("by_x"),
        py::arg("rotation_chaser_to_base"));
  m.def("certified_clearance", &certified, py::arg("chain"), py::arg("q"), py::arg("cubics"),
        py::arg("ways"), py::arg("times"), py::arg("centers"), py::arg("velocities"),
        py::arg("radii"), py::arg("gap"), py::arg("attached") = std::vector<Attached>());
}

}  // namespace ff
