// What distances are asked along and from.
#pragma once
#include <pybind11/stl.h>

#include "bindings/arrays.hpp"
#include "collision/clearance.hpp"

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

}  // namespace ff
