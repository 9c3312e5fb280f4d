// Python's way to the arm's points and to its distances from spheres.
#pragma once
#include "arrays.hpp"
#include "clearance.hpp"

namespace ff {

// Returns joint origins and end effector, and their derivatives along the columns of dq.
inline py::tuple arm_points_with_derivatives(const Chain& chain, const Array& q, const Array& dq) {
  const py::ssize_t n = chain.joints(), size = 6 + n;
  const double* of_q = checked(q, "q", {kAny, 7 + n});
  const py::ssize_t count = q.shape(0), xyz = 3;
  const double* of_dq = checked(dq, "q_sensitivity", {count, size, kAny});
  const py::ssize_t columns = dq.shape(2);
  Array points({count, n + 1, xyz}), derivatives({count, n + 1, xyz, columns});
  for (py::ssize_t i = 0; i < count; ++i) {
    const Arm arm(chain, Configuration::read(of_q + i * (7 + n), static_cast<int>(n)));
    Eigen::Map<ArmPoints>(points.mutable_data() + i * 3 * (n + 1), 3, n + 1) = arm.points;
    arm.derivatives(Eigen::Map<const RowMajor>(of_dq + i * size * columns, size, columns),
                    Eigen::Map<RowMajor>(derivatives.mutable_data() + i * 3 * (n + 1) * columns,
                                         3 * (n + 1), columns));
  }
  return py::make_tuple(result(points, "points"), result(derivatives, "derivatives"));
}

// Returns distances of interest, their derivatives and their names.
inline py::tuple clearances(const Chain& chain, const Array& q, const Array& dq, const Array& times,
                            const Array& centers, const Array& velocities, const Array& radii,
                            double interest, bool quarter_way) {
  const py::ssize_t n = chain.joints();
  const double* of_q = checked(q, "q", {kAny, 7 + n});
  const py::ssize_t count = q.shape(0);
  const double* of_dq = checked(dq, "q_sensitivity", {count, 6 + n, kAny});
  const py::ssize_t columns = dq.shape(2);
  const double* center = checked(centers, "centers", {kAny, 3});
  const py::ssize_t spheres = centers.shape(0);
  const double* velocity = checked(velocities, "velocities", {spheres, 3});
  const double* radius = checked(radii, "radii", {spheres});
  if (count < 2 || count % 2) throw std::invalid_argument("q must hold 2, 4, ... configurations");
  ArmMotion arm(chain, of_q, of_dq, static_cast<int>(count), static_cast<int>(columns));
  if (quarter_way) arm.add_quarter_way();
  std::vector<Sphere> all;
  for (py::ssize_t i = 0; i < spheres; ++i)
    all.push_back({vector3(center + 3 * i), vector3(velocity + 3 * i), radius[i]});
  const ClearanceRows rows =
      clearance_rows(arm, checked(times, "times", {static_cast<py::ssize_t>(arm.points.size())}),
                     all, checked(interest, "interest"));
  const py::ssize_t found = static_cast<py::ssize_t>(rows.distances.size());
  Array distances(found), jacobian({found, columns});
  std::copy(rows.distances.begin(), rows.distances.end(), distances.mutable_data());
  std::copy(rows.jacobian.begin(), rows.jacobian.end(), jacobian.mutable_data());
  return py::make_tuple(result(distances, "distances"), result(jacobian, "jacobian"),
                        py::array_t<long long>(found, rows.names.data()));
}

inline void bind_clearance(py::module_& m) {
  m.def("arm_points_with_derivatives", &arm_points_with_derivatives, py::arg("chain"), py::arg("q"),
        py::arg("q_sensitivity"));
  m.def("clearances", &clearances, py::arg("chain"), py::arg("q"), py::arg("q_sensitivity"),
        py::arg("times"), py::arg("centers"), py::arg("velocities"), py::arg("radii"),
        py::arg("interest"), py::arg("quarter_way"));
}

}  // namespace ff
