// Python's way to the distances of bodies.
#pragma once
#include "bind_clearance.hpp"
#include "bodies.hpp"
#include "body_certificate.hpp"

namespace ff {

inline Bodies bodies(const Numbers& carriers, const Array& rotations, const Array& positions,
                     const Array& centers, const Array& radii, const Numbers& kinds,
                     const Array& sizes, const Array& vertices, const Numbers& vertex_counts,
                     const Numbers& pairs) {
  const py::ssize_t count = carriers.ndim() > 0 ? carriers.shape(0) : 0;
  const long long* carrier = checked(carriers, "carriers", {count});
  const double* rotation = checked(rotations, "rotations", {count, 3, 3});
  const double* position = checked(positions, "positions", {count, 3});
  const double* center = checked(centers, "centers", {count, 3});
  const double* radius = checked(radii, "radii", {count});
  const double* size = checked(sizes, "sizes", {count, 3});
  const double* vertex = checked(vertices, "vertices", {kAny, 3});
  const long long* kind_of = checked(kinds, "kinds", {count});
  const long long* own_vertices = checked(vertex_counts, "vertex_counts", {count});
  const long long* pair = checked(pairs, "pairs", {kAny, 2});
  Bodies made;
  py::ssize_t used = 0;
  for (py::ssize_t i = 0; i < count; ++i) {
    const long long kind = kind_of[i], own = own_vertices[i];
    const std::string body = " of body " + std::to_string(i) + " is ";
    if (kind < 0 || kind > Solid::kHull)
      throw std::invalid_argument("kinds" + body + std::to_string(kind) + ", not 0 to 3");
    if (own < (kind == Solid::kHull) || own > vertices.shape(0) - used)
      throw std::invalid_argument("vertex_counts" + body + std::to_string(own) +
                                  ", and vertices has " + std::to_string(vertices.shape(0)));
    if (carrier[i] < 0 || carrier[i] > kMaxJoints)
      throw std::invalid_argument("carriers" + body + std::to_string(carrier[i]) +
                                  ", not the number of some joints");
    Solid solid{static_cast<Solid::Kind>(kind), vector3(size + 3 * i), {}};
    for (long long k = 0; k < own; ++k) solid.vertices.push_back(vector3(vertex + 3 * used++));
    made.bodies.push_back({static_cast<int>(carrier[i]),
                           {vector3(position + 3 * i), matrix3(rotation + 9 * i)},
                           vector3(center + 3 * i),
                           radius[i],
                           solid});
  }
  for (py::ssize_t i = 0; i < pairs.shape(0); ++i) {
    const long long a = pair[2 * i], b = pair[2 * i + 1];
    if (a < 0 || b < 0 || a >= count || b >= count)
      throw std::invalid_argument("pairs has " + std::to_string(a) + " and " + std::to_string(b) +
                                  ", and there are " + std::to_string(count) + " bodies");
    made.pairs.emplace_back(static_cast<int>(a), static_cast<int>(b));
  }
  return made;
}

inline void require_carried(const Chain& chain, const Bodies& of) {
  for (const Body& body : of.bodies)
    if (body.carriers > chain.joints()) throw std::invalid_argument("bodies are of another chain");
}

inline py::tuple written(const BodyRows& rows, py::ssize_t columns) {
  const auto found = static_cast<py::ssize_t>(rows.distances.size());
  Array distances(found), jacobian({found, columns});
  std::copy(rows.distances.begin(), rows.distances.end(), distances.mutable_data());
  std::copy(rows.jacobian.begin(), rows.jacobian.end(), jacobian.mutable_data());
  return py::make_tuple(
      result(distances, "distances"), result(jacobian, "jacobian"),
      py::array_t<long long>(found, rows.names.data()),
      py::array_t<long long>(static_cast<py::ssize_t>(rows.unknown.size()), rows.unknown.data()));
}

inline py::tuple rows_of_pairs(const Chain& chain, const Bodies& of, const Array& q,
                               const Array& dq, double interest) {
  const py::ssize_t n = chain.joints();
  const double* of_q = checked(q, "q", {kAny, 7 + n});
  const double* of_dq = checked(dq, "q_sensitivity", {q.shape(0), 6 + n, kAny});
  require_carried(chain, of);
  const py::ssize_t columns = dq.shape(2);
  return written(pair_rows(chain, of, of_q, of_dq, static_cast<int>(q.shape(0)),
                           static_cast<int>(columns), checked(interest, "interest")),
                 columns);
}

inline py::tuple rows_of_spheres(const Chain& chain, const Bodies& of, const Array& q,
                                 const Array& dq, const Array& times, const Array& centers,
                                 const Array& velocities, const Array& radii, double interest,
                                 const std::vector<Attached>& fixed, const Array& times_by_last) {
  const py::ssize_t n = chain.joints();
  const double* of_q = checked(q, "q", {kAny, 7 + n});
  const double* of_dq = checked(dq, "q_sensitivity", {q.shape(0), 6 + n, kAny});
  const double* time = checked(times, "times", {q.shape(0)});
  const std::vector<Sphere> spheres = moving_spheres(centers, velocities, radii, fixed);
  require_carried(chain, of);
  if (q.shape(0) == 0) throw std::invalid_argument("q has no configuration");
  const py::ssize_t columns = dq.shape(2);
  return written(
      sphere_rows(chain, of, of_q, of_dq, time, with_last(times_by_last, {q.shape(0)}, columns),
                  static_cast<int>(q.shape(0)), static_cast<int>(columns), spheres,
                  checked(interest, "interest")),
      columns);
}

// What a certificate of bodies is asked of.
struct Asked {
  Asked(const Chain& chain, const Bodies& of, const Array& q, const Array& cubics,
        const Array& ways, py::ssize_t columns, const Array& times, const Numbers& chosen,
        py::ssize_t numbers, int last, double gap, double part)
      : motion(read(chain, q, cubics, times)),
        ways(sums_of({checked(ways, "ways", {q.shape(0) - 1, columns}), q.shape(0) - 1, columns})) {
    require_carried(chain, of);
    if (!this->ways.allFinite()) throw std::invalid_argument("ways are too great to be added");
    const long long* number = checked(chosen, "chosen", {kAny});
    for (py::ssize_t i = 0; i < chosen.size(); ++i) {
      if (number[i] < 0 || number[i] >= numbers)
        throw std::invalid_argument("number " + std::to_string(number[i]) + " is chosen of " +
                                    std::to_string(numbers));
      this->chosen.push_back(static_cast<int>(number[i]));
    }
    if (last < 0 || last >= q.shape(0)) throw std::invalid_argument("last is no point");
    if (!(checked(gap, "gap") > 0)) throw std::invalid_argument("gap must be positive");
    if (!(checked(part, "part") >= 0 && part < 1))
      throw std::invalid_argument("part must be at least 0 and below 1");
  }

  CubicMotion motion;
  RowMajor ways;
  std::vector<int> chosen;

 private:
  static CubicMotion read(const Chain& chain, const Array& q, const Array& cubics,
                          const Array& times) {
    const py::ssize_t n = chain.joints(), three = 3;
    const double* of_q = checked(q, "q", {kAny, 7 + n});
    const py::ssize_t points = q.shape(0);
    if (points < 2) throw std::invalid_argument("q must hold two configurations or more");
    std::vector<Configuration> at;
    for (py::ssize_t i = 0; i < points; ++i)
      at.push_back(Configuration::read(of_q + i * (7 + n), static_cast<int>(n)));
    const double* of_cubics = checked(cubics, "cubics", {points - 1, three, 6 + n});
    return {chain,
            at,
            {of_cubics, 3 * (points - 1), 6 + n},
            {checked(times, "times", {points}), points}};
  }
};

inline double certified_pairs(const Chain& chain, const Bodies& of, const Array& q,
                              const Array& cubics, const Array& ways, const Array& times,
                              const Numbers& chosen, int last, double gap, double part) {
  const auto pairs = static_cast<py::ssize_t>(of.pairs.size());
  const Asked asked(chain, of, q, cubics, ways, pairs, times, chosen, pairs, last, gap, part);
  BodiesOnTheWay bodies(asked.motion, of);
  return Halving(PairsOnTheWay{bodies, asked.ways}, gap, part).least(asked.chosen, last);
}

inline double certified_spheres(const Chain& chain, const Bodies& of, const Array& q,
                                const Array& cubics, const Array& ways, const Array& times,
                                const Array& centers, const Array& velocities, const Array& radii,
                                const Numbers& chosen, int last, double gap, double part,
                                const std::vector<Attached>& fixed) {
  const std::vector<Sphere> spheres = moving_spheres(centers, velocities, radii, fixed);
  const auto count = static_cast<py::ssize_t>(of.bodies.size());
  const Asked asked(chain, of, q, cubics, ways, count, times, chosen,
                    count * static_cast<py::ssize_t>(spheres.size()), last, gap, part);
  BodiesOnTheWay bodies(asked.motion, of);
  return Halving(SpheresOnTheWay{bodies, asked.ways, spheres}, gap, part).least(asked.chosen, last);
}

inline void bind_bodies(py::module_& m) {
  py::class_<Bodies>(m, "Bodies")
      .def(py::init(&bodies), py::arg("carriers"), py::arg("rotations"), py::arg("positions"),
           py::arg("centers"), py::arg("radii"), py::arg("kinds"), py::arg("sizes"),
           py::arg("vertices"), py::arg("vertex_counts"), py::arg("pairs"));
  m.def("pair_rows", &rows_of_pairs, py::arg("chain"), py::arg("bodies"), py::arg("q"),
        py::arg("q_sensitivity"), py::arg("interest"));
  m.def("sphere_rows", &rows_of_spheres, py::arg("chain"), py::arg("bodies"), py::arg("q"),
        py::arg("q_sensitivity"), py::arg("times"), py::arg("centers"), py::arg("velocities"),
        py::arg("radii"), py::arg("interest"), py::arg("attached") = std::vector<Attached>(),
        py::arg("times_by_last") = Array(0));
  m.def("certified_pair_distance", &certified_pairs, py::arg("chain"), py::arg("bodies"),
        py::arg("q"), py::arg("cubics"), py::arg("ways"), py::arg("times"), py::arg("chosen"),
        py::arg("last"), py::arg("gap"), py::arg("part"));
  m.def("certified_sphere_distance", &certified_spheres, py::arg("chain"), py::arg("bodies"),
        py::arg("q"), py::arg("cubics"), py::arg("ways"), py::arg("times"), py::arg("centers"),
        py::arg("velocities"), py::arg("radii"), py::arg("chosen"), py::arg("last"), py::arg("gap"),
        py::arg("part"), py::arg("attached") = std::vector<Attached>());
}

}  // namespace ff
