// Python's way to obstacles of any shape, to distances of bodies from them and their certificate.
#include "collision/obstacles.hpp"

#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/distances.hpp"
#include "collision/obstacle_certificate.hpp"

namespace ff {
namespace {

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

py::tuple rows_of_obstacles(const BodiesAlong& along, const Array& times,
                            const Obstacles& obstacles, double interest,
                            const Array& times_by_last) {
  const Times at = times_of(along, times, times_by_last);
  return written(obstacle_rows(along, at, obstacles.all, checked(interest, "interest")),
                 along.path.variables());
}

double certified_obstacles(const CubicMotion& motion, const Bodies& of, const Array& ways,
                           const Obstacles& obstacles, const Numbers& chosen, int last, double gap,
                           double part) {
  require_carried(motion.chain, of);
  const size_t count = of.bodies.size();
  const RowMajor moved = sums(motion, ways, count);
  const Asked asked(chosen, static_cast<py::ssize_t>(count * obstacles.all.size()), last, motion,
                    gap, part);
  BodiesOnTheWay bodies(motion, of);
  return asked.least(ObstaclesOnTheWay{bodies, moved, obstacles.all});
}

}  // namespace

void bind_obstacles(py::module_& m) {
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
  m.def("obstacle_rows", &rows_of_obstacles, py::arg("along"), py::arg("times"),
        py::arg("obstacles"), py::arg("interest"), py::arg("times_by_last") = Array(0));
  m.def("certified_obstacle_distance", &certified_obstacles, py::arg("motion"), py::arg("bodies"),
        py::arg("ways"), py::arg("obstacles"), py::arg("chosen"), py::arg("last"), py::arg("gap"),
        py::arg("part"));
}

}  // namespace ff
