// Python's way to bodies and to what is in their way, and to certificates of their distances.

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/obstacles.hpp"
#include "collision/certificate.hpp"
#include "collision/obstacle_certificate.hpp"

namespace ff {
namespace {

Path path(const Chain& chain, const Array& q, const Array& dq) {
  const py::ssize_t n = chain.joints();
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  return {of_q, rows(dq, "q_sensitivity", {of_q.rows(), 6 + n, kAny})};
}

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

std::shared_ptr<TumblingBody> tumbling_body(const Array& position, const Array& velocity,
                                            const Array& begins, const Array& series) {
  const Values begin = values(begins, "begins", {kAny});
  const Rows terms = rows(series, "series", {begin.size(), kAny, 4});
  const py::ssize_t orders = series.shape(1);
  if (terms.rows() < 1) throw std::invalid_argument("series must not be empty");
  auto body = std::make_shared<TumblingBody>();
  body->position = vector3(position, "position");
  body->velocity = vector3(velocity, "velocity");
  body->begins.assign(begin.begin(), begin.end());
  for (py::ssize_t i = 0; i < begin.size(); ++i)
    body->series.push_back(terms.middleRows(i * orders, orders));
  return body;
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

Solid solid(int kind, const Array& sizes, const Array& vertices) {
  if (kind < 0 || kind > Solid::kCone)
    throw std::invalid_argument("kind is " + std::to_string(kind) + ", not 0 to 4");
  Solid made{static_cast<Solid::Kind>(kind), vector3(sizes, "sizes"), {}};
  const Rows vertex = rows(vertices, "vertices", {kAny, 3});
  for (Eigen::Index i = 0; i < vertex.rows(); ++i) made.vertices.push_back(vertex.row(i));
  if (kind == Solid::kHull && made.vertices.empty())
    throw std::invalid_argument("vertices has none, and the body is a hull");
  return made;
}

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

void require_carried(const Chain& chain, const Bodies& of) {
  for (const Body& body : of.bodies)
    if (body.carriers > chain.joints()) throw std::invalid_argument("bodies are of another chain");
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

  double least(DistancesOnTheWay&& of) const {
    return certified_least(of, chosen, last, gap, part);
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

using Others = std::variant<std::shared_ptr<Spheres>, std::shared_ptr<Obstacles>>;

double certified_others(const CubicMotion& motion, const Bodies& of, const Array& ways,
                        const Others& others, const Numbers& chosen, int last, double gap,
                        double part) {
  require_carried(motion.chain, of);
  const size_t count = of.bodies.size();
  const RowMajor moved = sums(motion, ways, count);
  BodiesOnTheWay bodies(motion, of);
  const auto asked = [&](const auto& all) {
    const auto pairs = static_cast<py::ssize_t>(count * all.size());
    return Asked(chosen, pairs, last, motion, gap, part);
  };
  if (const auto* spheres = std::get_if<0>(&others))
    return asked((*spheres)->all).least(SpheresOnTheWay{bodies, moved, (*spheres)->all});
  const std::vector<Obstacle>& all = std::get<1>(others)->all;
  return asked(all).least(ObstaclesOnTheWay{bodies, moved, all});
}

Obstacle obstacle(int kind, const Array& sizes, const Array& vertices, double grown,
                  const Array& center, double radius, const Array& rotation, const Array& position,
                  const Array& velocity, const Array& rate, double highest_speed,
                  const std::optional<std::shared_ptr<TumblingBody>>& body) {
  const Pose pose{vector3(position, "position"), matrix3(rotation, "rotation")};
  Solid made = solid(kind, sizes, vertices);
  made.grown = checked(grown, "grown");
  return {made,
          vector3(center, "center"),
          checked(radius, "radius"),
          pose,
          vector3(velocity, "velocity"),
          vector3(rate, "rate"),
          checked(highest_speed, "highest_speed"),
          body.value_or(nullptr)};
}

}  // namespace

void bind_collision(py::module_& m) {
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
  m.def("certified_clearance", &certified, py::arg("motion"), py::arg("ways"), py::arg("spheres"),
        py::arg("gap"), py::arg("part"));
  py::class_<Body>(m, "Body").def(py::init(&body), py::arg("carriers"), py::arg("rotation"),
                                  py::arg("position"), py::arg("center"), py::arg("radius"),
                                  py::arg("kind"), py::arg("sizes"), py::arg("vertices"));
  py::class_<Bodies, std::shared_ptr<Bodies>>(m, "Bodies")
      .def(py::init(&bodies), py::arg("bodies"), py::arg("pairs"));
  m.def("certified_pair_distance", &certified_pairs, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("chosen"), py::arg("last"), py::arg("gap"), py::arg("part"));
  py::class_<TumblingBody, std::shared_ptr<TumblingBody>>(m, "TumblingBody")
      .def(py::init(&tumbling_body), py::arg("position"), py::arg("velocity"), py::arg("begins"),
           py::arg("series"));
  py::class_<Obstacle>(m, "Obstacle")
      .def(py::init(&obstacle), py::arg("kind"), py::arg("sizes"), py::arg("vertices"),
           py::arg("grown"), py::arg("center"), py::arg("radius"), py::arg("rotation"),
           py::arg("position"), py::arg("velocity"), py::arg("rate"), py::arg("highest_speed"),
           py::arg("body"));
  py::class_<Obstacles, std::shared_ptr<Obstacles>>(m, "Obstacles")
      .def(py::init([](const std::vector<Obstacle>& all) { return Obstacles{all}; }),
           py::arg("obstacles"));
  m.def("certified_distance", &certified_others, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("others"), py::arg("chosen"), py::arg("last"), py::arg("gap"),
        py::arg("part"));
}

}  // namespace ff
