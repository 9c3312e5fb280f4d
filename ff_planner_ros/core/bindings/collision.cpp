// Python's way to bodies and to what is in their way, and to certificates of their distances.

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "collision/certificate.hpp"
#include "kinematics/arm.hpp"

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
  const Tree& tree = *chain.tree;
  const auto each = static_cast<py::ssize_t>(tree.moving(tree.tip).size()) + 1;
  const py::ssize_t count = q.shape(0), xyz = 3;
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

CubicMotion cubic_motion(const Chain& chain, const Array& q, const Array& v, const Array& times) {
  const py::ssize_t n = chain.joints();
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  const py::ssize_t points = of_q.rows();
  if (points < 2) throw std::invalid_argument("q must hold two configurations or more");
  std::vector<Configuration> at;
  for (py::ssize_t i = 0; i < points; ++i) at.push_back(Configuration::read(of_q.row(i)));
  return {chain, at, rows(v, "v", {points, 6 + n}), values(times, "times", {points})};
}

Solid solid(int kind, const Array& sizes, const Array& vertices, double grown) {
  if (kind < 0 || kind >= Solid::kKinds)
    throw std::invalid_argument("kind is " + std::to_string(kind) + ", not 0 to " +
                                std::to_string(Solid::kKinds - 1));
  Solid made{static_cast<Solid::Kind>(kind), vector3(sizes, "sizes"), {}, checked(grown, "grown")};
  const Rows vertex = rows(vertices, "vertices", {kAny, 3});
  for (Eigen::Index i = 0; i < vertex.rows(); ++i) made.vertices.push_back(vertex.row(i));
  if (kind == Solid::kHull && made.vertices.empty())
    throw std::invalid_argument("vertices has none, and the body is a hull");
  return made;
}

Body body(int link, const Array& rotation, const Array& position, const Array& center,
          double radius, const Solid& solid, const Array& slide) {
  if (link < 0 || link > kMaxJoints)
    throw std::invalid_argument("link is " + std::to_string(link) + ", not the number of a link");
  Body made{link,
            {vector3(position, "position"), matrix3(rotation, "rotation")},
            vector3(center, "center"),
            checked(radius, "radius"),
            solid,
            vector3(slide, "slide")};
  if (made.stretches() && solid.kind != Solid::kRound)
    throw std::invalid_argument("slide is that of a line, and the body has another shape");
  return made;
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
    if (bodies[a].stretches() || bodies[b].stretches())
      throw std::invalid_argument("pairs has a line whose length is not fixed");
    made.pairs.emplace_back(static_cast<int>(a), static_cast<int>(b));
  }
  return made;
}

Obstacle obstacle(const Solid& solid, const Array& center, double radius, const Array& rotation,
                  const Array& position, const Array& velocity, const Array& rate,
                  const std::optional<std::shared_ptr<TumblingBody>>& body) {
  return {solid,
          vector3(center, "center"),
          checked(radius, "radius"),
          {vector3(position, "position"), matrix3(rotation, "rotation")},
          vector3(velocity, "velocity"),
          vector3(rate, "rate"),
          body.value_or(nullptr)};
}

Asked asked(const CubicMotion& motion, const Bodies& of, const Numbers& chosen, size_t count,
            int last, double gap, double part) {
  for (const Body& body : of.bodies)
    if (!body.fits(*motion.chain.tree)) throw std::invalid_argument("bodies are of another chain");
  require_shape(chosen, "chosen", {kAny});
  Asked made{{}, last, checked(gap, "gap"), checked(part, "part")};
  for (py::ssize_t i = 0; i < chosen.size(); ++i) {
    const long long number = chosen.at(i);
    if (number < 0 || number >= static_cast<long long>(count))
      throw std::invalid_argument("number " + std::to_string(number) + " is chosen of " +
                                  std::to_string(count));
    made.numbers.push_back(static_cast<int>(number));
  }
  if (last < 0 || last >= motion.times.size()) throw std::invalid_argument("last is no point");
  if (!(gap > 0)) throw std::invalid_argument("gap must be positive");
  if (!(part >= 0 && part < 1)) throw std::invalid_argument("part must be at least 0 and below 1");
  return made;
}

double of_pairs(const CubicMotion& motion, const Bodies& bodies, const Numbers& chosen, int last,
                double gap, double part) {
  return certified_pairs(motion, bodies,
                         asked(motion, bodies, chosen, bodies.pairs.size(), last, gap, part));
}

double of_obstacles(const CubicMotion& motion, const Bodies& bodies, const Obstacles& obstacles,
                    const Numbers& chosen, int last, double gap, double part) {
  const size_t count = bodies.bodies.size() * obstacles.size();
  return certified_obstacles(motion, bodies, obstacles,
                             asked(motion, bodies, chosen, count, last, gap, part));
}

}  // namespace

void bind_collision(py::module_& m) {
  py::class_<CubicMotion>(m, "CubicMotion")
      .def(py::init(&cubic_motion), py::arg("chain"), py::arg("q"), py::arg("v"), py::arg("times"));
  m.def("arm_points_with_derivatives", &arm_points_with_derivatives, py::arg("chain"), py::arg("q"),
        py::arg("q_sensitivity"));
  py::class_<Solid>(m, "Solid")
      .def(py::init(&solid), py::arg("kind"), py::arg("sizes"), py::arg("vertices"),
           py::arg("grown"));
  py::class_<Body>(m, "Body").def(py::init(&body), py::arg("link"), py::arg("rotation"),
                                  py::arg("position"), py::arg("center"), py::arg("radius"),
                                  py::arg("solid"), py::arg("slide"));
  py::class_<Bodies, std::shared_ptr<Bodies>>(m, "Bodies")
      .def(py::init(&bodies), py::arg("bodies"), py::arg("pairs"));
  py::class_<TumblingBody, std::shared_ptr<TumblingBody>>(m, "TumblingBody")
      .def(py::init(&tumbling_body), py::arg("position"), py::arg("velocity"), py::arg("begins"),
           py::arg("series"));
  py::class_<Obstacle>(m, "Obstacle")
      .def(py::init(&obstacle), py::arg("solid"), py::arg("center"), py::arg("radius"),
           py::arg("rotation"), py::arg("position"), py::arg("velocity"), py::arg("rate"),
           py::arg("body"));
  py::class_<Obstacles, std::shared_ptr<Obstacles>>(m, "Obstacles")
      .def(py::init([](const std::vector<Obstacle>& all) { return Obstacles{all}; }),
           py::arg("obstacles"));
  m.def("certified_pairs", &of_pairs, py::arg("motion"), py::arg("bodies"), py::arg("chosen"),
        py::arg("last"), py::arg("gap"), py::arg("part"));
  m.def("certified_obstacles", &of_obstacles, py::arg("motion"), py::arg("bodies"),
        py::arg("obstacles"), py::arg("chosen"), py::arg("last"), py::arg("gap"), py::arg("part"));
}

}  // namespace ff
