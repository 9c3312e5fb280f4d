// Python's way to the distances of bodies and to their certificates.
#include "collision/bodies.hpp"

#include "bindings/bindings.hpp"
#include "bindings/distances.hpp"
#include "collision/body_certificate.hpp"

namespace ff {
namespace {

Body body(int carriers, const Array& rotation, const Array& position, const Array& center,
          double radius, int kind, const Array& sizes, const Array& vertices) {
  if (carriers < 0 || carriers > kMaxJoints)
    throw std::invalid_argument("carriers is " + std::to_string(carriers) +
                                ", not the number of some joints");
  if (kind < 0 || kind > Solid::kHull)
    throw std::invalid_argument("kind is " + std::to_string(kind) + ", not 0 to 3");
  Solid solid{static_cast<Solid::Kind>(kind), vector3(sizes, "sizes"), {}};
  const Rows vertex = rows(vertices, "vertices", {kAny, 3});
  for (Eigen::Index i = 0; i < vertex.rows(); ++i) solid.vertices.push_back(vertex.row(i));
  if (kind == Solid::kHull && solid.vertices.empty())
    throw std::invalid_argument("vertices has none, and the body is a hull");
  return {carriers,
          {vector3(position, "position"), matrix3(rotation, "rotation")},
          vector3(center, "center"),
          checked(radius, "radius"),
          solid};
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

void require_carried(const Chain& chain, const Bodies& of) {
  for (const Body& body : of.bodies)
    if (body.carriers > chain.joints()) throw std::invalid_argument("bodies are of another chain");
}

py::tuple written(const BodyRows& rows, py::ssize_t columns) {
  const auto found = static_cast<py::ssize_t>(rows.distances.size());
  return py::make_tuple(
      result(rows.distances, {found}, "distances"),
      result(rows.jacobian, {found, columns}, "jacobian"),
      py::array_t<long long>(found, rows.names.data()),
      py::array_t<long long>(static_cast<py::ssize_t>(rows.unknown.size()), rows.unknown.data()));
}

py::tuple rows_of_pairs(const Chain& chain, const Bodies& of, const Array& q, const Array& dq,
                        double interest) {
  const Path along = path(chain, q, dq);
  require_carried(chain, of);
  return written(pair_rows(chain, of, along, checked(interest, "interest")), dq.shape(2));
}

py::tuple rows_of_spheres(const Chain& chain, const Bodies& of, const Array& q, const Array& dq,
                          const Array& times, const Spheres& spheres, double interest,
                          const Array& times_by_last) {
  const Path along = path(chain, q, dq);
  const Times at = times_of(along, q.shape(0), times, times_by_last);
  require_carried(chain, of);
  if (q.shape(0) == 0) throw std::invalid_argument("q has no configuration");
  return written(sphere_rows(chain, of, along, at, spheres.all, checked(interest, "interest")),
                 dq.shape(2));
}

// Which of some numbered distances a certificate is asked of, and how closely.
struct Asked {
  Asked(const Numbers& chosen, py::ssize_t count, int last, const CubicMotion& motion, double gap,
        double part)
      : last(last), gap(checked(gap, "gap")), part(checked(part, "part")) {
    require_shape(chosen, "chosen", {kAny});
    for (py::ssize_t i = 0; i < chosen.size(); ++i) {
      const long long number = chosen.at(i);
      if (number < 0 || number >= count)
        throw std::invalid_argument("number " + std::to_string(number) + " is chosen of " +
                                    std::to_string(count));
      this->chosen.push_back(static_cast<int>(number));
    }
    if (last < 0 || last >= motion.times.size()) throw std::invalid_argument("last is no point");
    if (!(gap > 0)) throw std::invalid_argument("gap must be positive");
    if (!(part >= 0 && part < 1))
      throw std::invalid_argument("part must be at least 0 and below 1");
  }

  template <typename Measured>
  double least(const Measured& measured) const {
    return Halving(measured, gap, part).least(chosen, last);
  }

  std::vector<int> chosen;
  int last;
  double gap, part;
};

RowMajor sums(const CubicMotion& motion, const Array& ways, size_t columns) {
  const py::ssize_t intervals = motion.times.size() - 1;
  const RowMajor found =
      sums_of(rows(ways, "ways", {intervals, static_cast<py::ssize_t>(columns)}));
  if (!found.allFinite()) throw std::invalid_argument("ways are too great to be added");
  return found;
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
  py::class_<Bodies>(m, "Bodies").def(py::init(&bodies), py::arg("bodies"), py::arg("pairs"));
  m.def("pair_rows", &rows_of_pairs, py::arg("chain"), py::arg("bodies"), py::arg("q"),
        py::arg("q_sensitivity"), py::arg("interest"));
  m.def("sphere_rows", &rows_of_spheres, py::arg("chain"), py::arg("bodies"), py::arg("q"),
        py::arg("q_sensitivity"), py::arg("times"), py::arg("spheres"), py::arg("interest"),
        py::arg("times_by_last") = Array(0));
  m.def("certified_pair_distance", &certified_pairs, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("chosen"), py::arg("last"), py::arg("gap"), py::arg("part"));
  m.def("certified_sphere_distance", &certified_spheres, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("spheres"), py::arg("chosen"), py::arg("last"), py::arg("gap"),
        py::arg("part"));
}

}  // namespace ff
