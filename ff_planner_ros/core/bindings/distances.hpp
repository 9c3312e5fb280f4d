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

inline Path path(const Chain& chain, const Array& q, const Array& dq) {
  const py::ssize_t n = chain.joints();
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  return {of_q, rows(dq, "q_sensitivity", {of_q.rows(), 6 + n, kAny})};
}

inline Times times_of(const Path& path, py::ssize_t count, const Array& times,
                      const Array& by_last) {
  const Values at = values(times, "times", {count});
  if (by_last.size() == 0) return {at, values(by_last)};
  if (path.dq.cols() < 1) throw std::invalid_argument("there is no last variable");
  return {at, values(by_last, "times_by_last", {count})};
}

}  // namespace ff
