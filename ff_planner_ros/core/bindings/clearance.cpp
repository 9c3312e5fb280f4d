// Python's way to the arm's points, to its distances from spheres and to their certificate.
#include "collision/clearance.hpp"

#include "bindings/bindings.hpp"
#include "bindings/distances.hpp"
#include "collision/certificate.hpp"

namespace ff {
namespace {

// Returns joint origins and end effector, and their derivatives along the columns of dq.
py::tuple arm_points_with_derivatives(const Chain& chain, const Array& q, const Array& dq) {
  const Path along = path(chain, q, dq);
  const py::ssize_t count = q.shape(0), each = chain.joints() + 1, xyz = 3;
  Array points({count, each, xyz}), derivatives({count, each, xyz, dq.shape(2)});
  RowsToFill of_points = rows_to_fill(points), of_derivatives = rows_to_fill(derivatives);
  for (py::ssize_t i = 0; i < count; ++i) {
    const Arm arm(chain, Configuration::read(along.q.row(i)));
    of_points.middleRows(i * each, each) = arm.points.transpose();
    arm.derivatives(along.derivatives(i), of_derivatives.middleRows(i * 3 * each, 3 * each));
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

Attached attached(const std::vector<int>& spheres, const Array& places, const Array& position,
                  const Array& velocity, const Array& begins, const Array& series,
                  double fastest_turn) {
  const py::ssize_t count = static_cast<py::ssize_t>(spheres.size());
  for (const int sphere : spheres)
    if (sphere < 0)
      throw std::invalid_argument("spheres has " + std::to_string(sphere) + ", which is none");
  const Rows place = rows(places, "places", {count, 3});
  std::vector<Vector3> all;
  for (py::ssize_t i = 0; i < count; ++i) all.push_back(place.row(i));
  return {tumbling_body(position, velocity, begins, series), checked(fastest_turn, "fastest_turn"),
          spheres, all};
}

Spheres spheres(const Array& centers, const Array& velocities, const Array& radii,
                const std::vector<Attached>& fixed) {
  const Rows center = rows(centers, "centers", {kAny, 3});
  const py::ssize_t count = center.rows();
  const Rows velocity = rows(velocities, "velocities", {count, 3});
  const Values radius = values(radii, "radii", {count});
  std::vector<Sphere> all;
  for (py::ssize_t i = 0; i < count; ++i) {
    const Vector3 moving = velocity.row(i);
    all.push_back({center.row(i), moving, radius[i], moving.norm(), nullptr, moving});
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
  return {all};
}

// Returns distances of interest, their derivatives and their names.
py::tuple clearances(const Chain& chain, const Array& q, const Array& dq, const Array& times,
                     const Spheres& spheres, double interest, bool quarter_way,
                     const Array& times_by_last) {
  const Path along = path(chain, q, dq);
  const py::ssize_t count = q.shape(0);
  if (count < 2 || count % 2) throw std::invalid_argument("q must hold 2, 4, ... configurations");
  ArmMotion arm(chain, along);
  if (quarter_way) arm.add_quarter_way();
  const auto looked_at = static_cast<py::ssize_t>(arm.points.size());
  const Times at = times_of(looked_at, dq.shape(2), times, times_by_last);
  return written(clearance_rows(arm, at, spheres.all, checked(interest, "interest")), dq.shape(2));
}

CubicMotion cubic_motion(const Chain& chain, const Array& q, const Array& cubics,
                         const Array& times) {
  const py::ssize_t n = chain.joints();
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  const py::ssize_t points = of_q.rows();
  if (points < 2) throw std::invalid_argument("q must hold two configurations or more");
  std::vector<Configuration> at;
  for (py::ssize_t i = 0; i < points; ++i) at.push_back(Configuration::read(of_q.row(i)));
  return {chain, at, rows(cubics, "cubics", {points - 1, 3, 6 + n}),
          values(times, "times", {points})};
}

double certified(const CubicMotion& motion, const Array& ways, const Spheres& spheres, double gap,
                 double part) {
  const Values of_ways = values(ways, "ways", {motion.times.size() - 1});
  if (!(checked(gap, "gap") > 0)) throw std::invalid_argument("gap must be positive");
  if (!(checked(part, "part") >= 0 && part < 1))
    throw std::invalid_argument("part must be at least 0 and below 1");
  if (spheres.all.empty()) return std::numeric_limits<double>::infinity();
  return certified_clearance(motion, of_ways, spheres.all, gap, part);
}

}  // namespace

void bind_clearance(py::module_& m) {
  py::class_<Attached>(m, "Attached")
      .def(py::init(&attached), py::arg("spheres"), py::arg("places"), py::arg("position"),
           py::arg("velocity"), py::arg("begins"), py::arg("series"), py::arg("fastest_turn"));
  py::class_<Spheres, std::shared_ptr<Spheres>>(m, "Spheres")
      .def(py::init(&spheres), py::arg("centers"), py::arg("velocities"), py::arg("radii"),
           py::arg("attached") = std::vector<Attached>());
  py::class_<CubicMotion>(m, "CubicMotion")
      .def(py::init(&cubic_motion), py::arg("chain"), py::arg("q"), py::arg("cubics"),
           py::arg("times"));
  m.def("arm_points_with_derivatives", &arm_points_with_derivatives, py::arg("chain"), py::arg("q"),
        py::arg("q_sensitivity"));
  m.def("clearances", &clearances, py::arg("chain"), py::arg("q"), py::arg("q_sensitivity"),
        py::arg("times"), py::arg("spheres"), py::arg("interest"), py::arg("quarter_way"),
        py::arg("times_by_last") = Array(0));
  m.def("certified_clearance", &certified, py::arg("motion"), py::arg("ways"), py::arg("spheres"),
        py::arg("gap"), py::arg("part"));
}

}  // namespace ff
