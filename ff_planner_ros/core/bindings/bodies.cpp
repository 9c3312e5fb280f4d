// Python's way to the distances of bodies and to their certificates.
#include "collision/bodies.hpp"

#include "bindings/bindings.hpp"
#include "bindings/distances.hpp"

namespace ff {
namespace {

Body body(int carriers, const Array& rotation, const Array& position, const Array& center,
          double radius, int kind, const Array& sizes, const Array& vertices) {
  if (carriers < 0 || carriers > kMaxJoints)
    throw std::invalid_argument("carriers is " + std::to_string(carriers) +
                                ", not the number of some joints");
  return {carriers,
          {vector3(position, "position"), matrix3(rotation, "rotation")},
          vector3(center, "center"),
          checked(radius, "radius"),
          solid(kind, sizes, vertices)};
}

Bodies bodies(const std::vector<Body>& bodies, const Numbers& pairs) {
  require_shape(pairs, "pairs", {kAny, 2});
  Bodies made{bodies, {}};
  const auto count = static_cast<long long>(bodies.size());
  for (py::ssize_t i = 0; i < pairs.shape(0); ++i) {
    const long long a = pairs.at(i, 0), b = pairs.at(i, 1);
    if (a < 0 || b < 0 || a >= count || b >= count)
      throw std::invalid_argument("pairs has " + std::to_string(a) + " and " + std::to_string(b) +
                                  ", and there are " + std::to_string(count) + " bodies");
    made.pairs.emplace_back(static_cast<int>(a), static_cast<int>(b));
  }
  return made;
}

BodiesAlong bodies_along(const Chain& chain, const Bodies& of, const Array& q, const Array& dq,
                         const Array& q_half_way, const Array& dq_half_way, bool quarter_way) {
  require_carried(chain, of);
  const Path points = path(chain, q, dq);
  if (points.q.rows() == 0) throw std::invalid_argument("q has no configuration");
  if (q_half_way.size() == 0) {
    if (quarter_way)
      throw std::invalid_argument("q_half_way has none, and quarter_way is asked for");
    return {chain, of, DensePath(points)};
  }
  const Path half_way{
      rows(q_half_way, "q_half_way", {q.shape(0), q.shape(1)}),
      rows(dq_half_way, "q_half_way_sensitivity", {dq.shape(0), dq.shape(1), dq.shape(2)})};
  return {chain, of, DensePath(points, half_way, quarter_way)};
}

// Where the end effector is, in the inertial frame.
Array tips(const BodiesAlong& along) {
  RowMajor found(along.at.size(), 3);
  for (size_t i = 0; i < along.at.size(); ++i) found.row(i) = along.tip(i);
  return result(found, "tips");
}

Array sensitivity(const BodiesAlong& along) {
  const py::ssize_t size = along.path.q.cols() - 1;
  Array found({along.path.q.rows(), size, along.path.variables()});
  RowsToFill of_found = rows_to_fill(found);
  for (Eigen::Index i = 0; i < along.path.q.rows(); ++i)
    of_found.middleRows(i * size, size) = along.path.derivatives(i);
  return result(found, "q_sensitivity");
}

py::tuple rows_of_pairs(const BodiesAlong& along, double interest) {
  return written(pair_rows(along, checked(interest, "interest")), along.path.variables());
}

py::tuple rows_of_spheres(const BodiesAlong& along, const Array& times, const Spheres& spheres,
                          double interest, const Array& times_by_last) {
  const Times at = times_of(along, times, times_by_last);
  return written(sphere_rows(along, at, spheres.all, checked(interest, "interest")),
                 along.path.variables());
}

double certified_pairs(const CubicMotion& motion, const Bodies& of, const Array& ways,
                       const Numbers& chosen, int last, double gap, double part) {
  require_carried(motion.chain, of);
  const size_t pairs = of.pairs.size();
  const RowMajor moved = sums(motion, ways, pairs);
  const Asked asked(chosen, static_cast<py::ssize_t>(pairs), last, motion, gap, part);
  BodiesOnTheWay bodies(motion, of);
  return asked.least(PairsOnTheWay{bodies, moved});
}

double certified_spheres(const CubicMotion& motion, const Bodies& of, const Array& ways,
                         const Spheres& spheres, const Numbers& chosen, int last, double gap,
                         double part) {
  require_carried(motion.chain, of);
  const size_t count = of.bodies.size();
  const RowMajor moved = sums(motion, ways, count);
  const Asked asked(chosen, static_cast<py::ssize_t>(count * spheres.all.size()), last, motion, gap,
                    part);
  BodiesOnTheWay bodies(motion, of);
  return asked.least(SpheresOnTheWay{bodies, moved, spheres.all});
}

}  // namespace

void bind_bodies(py::module_& m) {
  py::class_<Body>(m, "Body").def(py::init(&body), py::arg("carriers"), py::arg("rotation"),
                                  py::arg("position"), py::arg("center"), py::arg("radius"),
                                  py::arg("kind"), py::arg("sizes"), py::arg("vertices"));
  py::class_<Bodies, std::shared_ptr<Bodies>>(m, "Bodies")
      .def(py::init(&bodies), py::arg("bodies"), py::arg("pairs"));
  py::class_<BodiesAlong>(m, "BodiesAlong")
      .def(py::init(&bodies_along), py::arg("chain"), py::arg("bodies"), py::arg("q"),
           py::arg("q_sensitivity"), py::arg("q_half_way") = Array(0),
           py::arg("q_half_way_sensitivity") = Array(0), py::arg("quarter_way") = false,
           py::keep_alive<1, 3>())  // the bodies are not copied
      .def_property_readonly("q", [](const BodiesAlong& of) { return result(of.path.q, "q"); })
      .def_property_readonly("q_sensitivity", &sensitivity)
      .def_property_readonly("tips", &tips);
  m.def("pair_rows", &rows_of_pairs, py::arg("along"), py::arg("interest"));
  m.def("sphere_rows", &rows_of_spheres, py::arg("along"), py::arg("times"), py::arg("spheres"),
        py::arg("interest"), py::arg("times_by_last") = Array(0));
  m.def("certified_pair_distance", &certified_pairs, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("chosen"), py::arg("last"), py::arg("gap"), py::arg("part"));
  m.def("certified_sphere_distance", &certified_spheres, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("spheres"), py::arg("chosen"), py::arg("last"), py::arg("gap"),
        py::arg("part"));
}

}  // namespace ff
