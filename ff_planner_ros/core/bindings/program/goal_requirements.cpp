// Python's way to what the core requires of paths with respect to the goal.
#include "program/goal_requirements.hpp"

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"

namespace ff {
namespace {

using Requirement = std::shared_ptr<PathRequirement>;

GraspSeen grasp_seen(const Array& positions, const Array& rotations, const Array& counts,
                     const Array& twists, bool moves_with_goal) {
  const Rows places = rows(positions, "positions", {kAny, 3});
  const py::ssize_t times = places.rows();
  return {places, rows(rotations, "rotations", {times, 3, 3}), vector3(counts, "counts"),
          rows(twists, "twists", {times, 6}), moves_with_goal};
}

Requirement in_corridor(const GraspSeen& grasp, const Array& direction, double distance,
                        double half_angle, double radius, double back_off, double margin,
                        double interest) {
  const auto made = std::make_shared<InCorridor>();
  made->grasp = grasp;
  made->direction = vector3(direction, "direction");
  made->distance = checked(distance, "distance");
  made->half_angle = checked(half_angle, "half_angle");
  made->radius = checked(radius, "radius");
  made->back_off = checked(back_off, "back_off");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  return made;
}

Requirement goal_in_view(const GraspSeen& grasp, int carrier, const Array& rotation,
                         const Array& position, const Array& axis, double half_angle, double until,
                         double margin, double interest) {
  const auto made = std::make_shared<GoalInView>();
  made->grasp = grasp;
  if (carrier < 0) throw std::invalid_argument("carrier must be zero or more");
  made->carrier = carrier;
  made->mount = {vector3(position, "position"), matrix3(rotation, "rotation")};
  made->axis = vector3(axis, "axis");
  made->half_angle = checked(half_angle, "half_angle");
  made->until = checked(until, "until");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  return made;
}

}  // namespace

void bind_goal_requirements(py::module_& m) {
  py::class_<GraspSeen>(m, "GraspSeen")
      .def(py::init(&grasp_seen), py::arg("positions"), py::arg("rotations"), py::arg("counts"),
           py::arg("twists"), py::arg("moves_with_goal"));
  m.def("in_corridor", &in_corridor, py::arg("grasp"), py::arg("direction"), py::arg("distance"),
        py::arg("half_angle"), py::arg("radius"), py::arg("back_off"), py::arg("margin"),
        py::arg("interest"));
  m.def("goal_in_view", &goal_in_view, py::arg("grasp"), py::arg("carrier"), py::arg("rotation"),
        py::arg("position"), py::arg("axis"), py::arg("half_angle"), py::arg("until"),
        py::arg("margin"), py::arg("interest"));
}

}  // namespace ff
