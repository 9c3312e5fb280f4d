// Solids and what is asked about distances of bodies, as Python says it.
#pragma once
#include "bindings/distances.hpp"
#include "collision/body_certificate.hpp"

namespace ff {

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
