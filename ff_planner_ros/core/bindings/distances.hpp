// What distances are asked along and from, solids, and certificates, as Python says it.
#pragma once
#include <pybind11/stl.h>

#include "bindings/arrays.hpp"
#include "collision/body_certificate.hpp"
#include "collision/obstacles.hpp"

namespace ff {

// Spheres as Python holds them.
struct Spheres {
  std::vector<Sphere> all;
};

inline std::shared_ptr<TumblingBody> tumbling_body(const Array& position, const Array& velocity,
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

inline Path path(const Chain& chain, const Array& q, const Array& dq) {
  const py::ssize_t n = chain.joints();
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  return {of_q, rows(dq, "q_sensitivity", {of_q.rows(), 6 + n, kAny})};
}

inline py::tuple written(const ClearanceRows& rows, py::ssize_t variables) {
  const auto found = static_cast<py::ssize_t>(rows.distances.size());
  return py::make_tuple(result(rows.distances, {found}, "distances"),
                        result(rows.jacobian, {found, variables}, "jacobian"),
                        py::array_t<long long>(found, rows.names.data()));
}

inline Times times_of(py::ssize_t count, py::ssize_t variables, const Array& times,
                      const Array& by_last) {
  const Values at = values(times, "times", {count});
  if (by_last.size() == 0) return {at, values(by_last)};
  if (variables < 1) throw std::invalid_argument("there is no last variable");
  return {at, values(by_last, "times_by_last", {count})};
}

// Obstacles as Python holds them: they are not copied with every question.
struct Obstacles {
  std::vector<Obstacle> all;
};

inline Solid solid(int kind, const Array& sizes, const Array& vertices) {
  if (kind < 0 || kind > Solid::kCone)
    throw std::invalid_argument("kind is " + std::to_string(kind) + ", not 0 to 4");
  Solid made{static_cast<Solid::Kind>(kind), vector3(sizes, "sizes"), {}};
  const Rows vertex = rows(vertices, "vertices", {kAny, 3});
  for (Eigen::Index i = 0; i < vertex.rows(); ++i) made.vertices.push_back(vertex.row(i));
  if (kind == Solid::kHull && made.vertices.empty())
    throw std::invalid_argument("vertices has none, and the body is a hull");
  return made;
}

inline Times times_of(const BodiesAlong& along, const Array& times, const Array& by_last) {
  return times_of(along.path.q.rows(), along.path.variables(), times, by_last);
}

inline void require_carried(const Chain& chain, const Bodies& of) {
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

  template <typename Measured>
  double least(const Measured& measured) const {
    return Halving(measured, gap, part).least(chosen, last);
  }

  std::vector<int> chosen;
  int last;
  double gap, part;
};

inline RowMajor sums(const CubicMotion& motion, const Array& ways, size_t columns) {
  const py::ssize_t intervals = motion.times.size() - 1;
  const RowMajor found =
      sums_of(rows(ways, "ways", {intervals, static_cast<py::ssize_t>(columns)}));
  if (!found.allFinite()) throw std::invalid_argument("ways are too great to be added");
  return found;
}

}  // namespace ff
