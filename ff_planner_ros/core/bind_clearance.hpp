// Python's way to the arm's points and to its distances from spheres.
#pragma once
#include <pybind11/stl.h>

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

// A body and the spheres that are fixed to it.
struct Attached {
  std::shared_ptr<const TumblingBody> body;
  double fastest_turn;  // that it never exceeds [rad/s]
  std::vector<int> spheres;
  std::vector<Vector3> places;
};

inline Attached attached(const std::vector<int>& spheres, const Array& places,
                         const Array& position, const Array& velocity, const Array& begins,
                         const Array& series, double fastest_turn) {
  const py::ssize_t count = static_cast<py::ssize_t>(spheres.size()), xyz = 3, xyzw = 4;
  for (const int sphere : spheres)
    if (sphere < 0)
      throw std::invalid_argument("spheres has " + std::to_string(sphere) + ", which is none");
  const double* place = checked(places, "places", {count, xyz});
  const double* begin = checked(begins, "begins", {kAny});
  const py::ssize_t pieces = begins.shape(0);
  const double* terms = checked(series, "series", {pieces, kAny, xyzw});
  const py::ssize_t orders = series.shape(1);
  if (pieces < 1 || orders < 1) throw std::invalid_argument("series must not be empty");
  auto body = std::make_shared<TumblingBody>();
  body->position = vector3(checked(position, "position", {xyz}));
  body->velocity = vector3(checked(velocity, "velocity", {xyz}));
  body->begins.assign(begin, begin + pieces);
  for (py::ssize_t i = 0; i < pieces; ++i)
    body->series.push_back(
        Eigen::Map<const TumblingBody::Series>(terms + i * orders * 4, orders, 4));
  std::vector<Vector3> all;
  for (py::ssize_t i = 0; i < count; ++i) all.push_back(vector3(place + 3 * i));
  return {body, checked(fastest_turn, "fastest_turn"), spheres, all};
}

inline std::vector<Sphere> moving_spheres(const Array& centers, const Array& velocities,
                                          const Array& radii, const std::vector<Attached>& fixed) {
  const double* center = checked(centers, "centers", {kAny, 3});
  const py::ssize_t count = centers.shape(0);
  const double* velocity = checked(velocities, "velocities", {count, 3});
  const double* radius = checked(radii, "radii", {count});
  std::vector<Sphere> all;
  for (py::ssize_t i = 0; i < count; ++i) {
    const Vector3 moving = vector3(velocity + 3 * i);
    all.push_back({vector3(center + 3 * i), moving, radius[i], moving.norm(), nullptr, moving});
  }
  for (const Attached& of : fixed)
    for (size_t k = 0; k < of.spheres.size(); ++k) {
      if (of.spheres[k] >= count)
        throw std::invalid_argument("attached has sphere " + std::to_string(of.spheres[k]) +
                                    ", and there are " + std::to_string(count));
      Sphere& sphere = all[of.spheres[k]];
      sphere.body = of.body;
      sphere.place = of.places[k];
      sphere.highest_speed = of.body->velocity.norm() + of.fastest_turn * of.places[k].norm();
    }
  for (const Sphere& sphere : all)
    if (!std::isfinite(sphere.highest_speed))
      throw std::invalid_argument("velocities are too great to be squared");
  return all;
}

// Derivatives of times by the last variable; null where there are none.
inline const double* with_last(const Array& times_by_last, const Shape& shape,
                               py::ssize_t columns) {
  if (times_by_last.size() == 0) return nullptr;
  if (columns < 1) throw std::invalid_argument("there is no last variable");
  return checked(times_by_last, "times_by_last", shape);
}

// Returns distances of interest, their derivatives and their names.
inline py::tuple clearances(const Chain& chain, const Array& q, const Array& dq, const Array& times,
                            const Array& centers, const Array& velocities, const Array& radii,
                            double interest, bool quarter_way, const std::vector<Attached>& fixed,
                            const Array& times_by_last) {
  const py::ssize_t n = chain.joints();
  const double* of_q = checked(q, "q", {kAny, 7 + n});
  const py::ssize_t count = q.shape(0);
  const double* of_dq = checked(dq, "q_sensitivity", {count, 6 + n, kAny});
  const py::ssize_t columns = dq.shape(2);
  const std::vector<Sphere> all = moving_spheres(centers, velocities, radii, fixed);
  if (count < 2 || count % 2) throw std::invalid_argument("q must hold 2, 4, ... configurations");
  ArmMotion arm(chain, of_q, of_dq, static_cast<int>(count), static_cast<int>(columns));
  if (quarter_way) arm.add_quarter_way();
  const Shape shape{static_cast<py::ssize_t>(arm.points.size())};
  const ClearanceRows rows =
      clearance_rows(arm, checked(times, "times", shape), with_last(times_by_last, shape, columns),
                     all, checked(interest, "interest"));
  const py::ssize_t found = static_cast<py::ssize_t>(rows.distances.size());
  Array distances(found), jacobian({found, columns});
  std::copy(rows.distances.begin(), rows.distances.end(), distances.mutable_data());
  std::copy(rows.jacobian.begin(), rows.jacobian.end(), jacobian.mutable_data());
  return py::make_tuple(result(distances, "distances"), result(jacobian, "jacobian"),
                        py::array_t<long long>(found, rows.names.data()));
}

inline void bind_clearance(py::module_& m) {
  py::class_<Attached>(m, "Attached")
      .def(py::init(&attached), py::arg("spheres"), py::arg("places"), py::arg("position"),
           py::arg("velocity"), py::arg("begins"), py::arg("series"), py::arg("fastest_turn"));
  m.def("arm_points_with_derivatives", &arm_points_with_derivatives, py::arg("chain"), py::arg("q"),
        py::arg("q_sensitivity"));
  m.def("clearances", &clearances, py::arg("chain"), py::arg("q"), py::arg("q_sensitivity"),
        py::arg("times"), py::arg("centers"), py::arg("velocities"), py::arg("radii"),
        py::arg("interest"), py::arg("quarter_way"), py::arg("attached") = std::vector<Attached>(),
        py::arg("times_by_last") = Array(0));
}

}  // namespace ff
