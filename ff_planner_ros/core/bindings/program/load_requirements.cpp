// Python's way to limits of what motions take of joints, grasps and wheels.
#include "program/load_requirements.hpp"

#include <pybind11/stl.h>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"

namespace ff {
namespace {

using Requirement = std::shared_ptr<PathRequirement>;

template <typename Loads>
std::shared_ptr<Loads> loads_within(double margin, double interest, double step) {
  const auto made = std::make_shared<Loads>();
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  made->step = checked(step, "step");
  if (!(step > 0)) throw std::invalid_argument("step must be positive");
  return made;
}

Requirement accelerations_within(const Array& parts, double margin, double interest, double step,
                                 bool between) {
  const auto made = loads_within<AccelerationsWithin>(margin, interest, step);
  made->parts = values(parts, "parts", {kAny});
  made->between = between;
  return made;
}

Requirement torques_within(const std::string& base, const Array& parts, double margin,
                           double interest, double step) {
  const auto made = loads_within<TorquesWithin>(margin, interest, step);
  made->base = base_named(base);
  made->parts = values(parts, "parts", {kAny});
  return made;
}

Requirement grasp_wrench_within(const std::string& base, int joints_before, const Array& position,
                                const Array& rotation, double mass, const Array& center,
                                const Array& inertia, const Array& parts, double margin,
                                double interest, double step) {
  const auto made = loads_within<GraspWrenchWithin>(margin, interest, step);
  made->base = base_named(base);
  if (joints_before < 0) throw std::invalid_argument("joints_before must not be negative");
  made->joints_before = joints_before;
  made->frame = {vector3(position, "position"), matrix3(rotation, "rotation")};
  made->mass = checked(mass, "mass");
  made->center = vector3(center, "center");
  made->inertia = matrix3(inertia, "inertia");
  const Values of_kinds = values(parts, "parts", {2});
  made->parts[0] = of_kinds[0];
  made->parts[1] = of_kinds[1];
  return made;
}

Wheels wheels(const Array& shares, const Array& stored) {
  const Rows of_wheels = rows(shares, "shares", {kAny, 3});
  return {of_wheels, values(stored, "stored", {of_wheels.rows()})};
}

Requirement wheels_within(const Wheels& wheels, const Array& momenta, const Array& torques,
                          double excess, double margin, double interest, double step,
                          bool between) {
  const auto made = loads_within<WheelsWithin>(margin, interest, step);
  made->wheels = wheels;
  made->momenta = values(momenta, "momenta", {wheels.count()});
  made->torques = values(torques, "torques", {wheels.count()});
  made->excess = checked(excess, "excess");
  made->between = between;
  return made;
}

}  // namespace

void bind_load_requirements(py::module_& m) {
  m.def("accelerations_within", &accelerations_within, py::arg("parts"), py::arg("margin"),
        py::arg("interest"), py::arg("step"), py::arg("between"));
  m.def("torques_within", &torques_within, py::arg("base"), py::arg("parts"), py::arg("margin"),
        py::arg("interest"), py::arg("step"));
  m.def("grasp_wrench_within", &grasp_wrench_within, py::arg("base"), py::arg("joints_before"),
        py::arg("position"), py::arg("rotation"), py::arg("mass"), py::arg("center"),
        py::arg("inertia"), py::arg("parts"), py::arg("margin"), py::arg("interest"),
        py::arg("step"));
  py::class_<Wheels>(m, "Wheels").def(py::init(&wheels), py::arg("shares"), py::arg("stored"));
  m.def("wheels_within", &wheels_within, py::arg("wheels"), py::arg("momenta"), py::arg("torques"),
        py::arg("excess"), py::arg("margin"), py::arg("interest"), py::arg("step"),
        py::arg("between"));
}

}  // namespace ff
