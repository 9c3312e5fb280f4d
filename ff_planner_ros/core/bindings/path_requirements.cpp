// Python's way to what the core knows to require of paths.
#include "program/path_requirements.hpp"

#include <pybind11/stl.h>

#include "bindings/bindings.hpp"
#include "bindings/distances.hpp"

namespace ff {
namespace {

using Requirement = std::shared_ptr<PathRequirement>;

Requirement positions_within(const Array& lower, const Array& upper, double excess, double margin,
                             double interest, double stop_interest, double jerk, double step) {
  const auto made = std::make_shared<PositionsWithin>();
  made->lower = values(lower, "lower", {kAny});
  made->upper = values(upper, "upper", {made->lower.size()});
  made->excess = checked(excess, "excess");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  made->stop_interest = checked(stop_interest, "stop_interest");
  made->jerk = checked(jerk, "jerk");
  made->step = checked(step, "step");
  return made;
}

Requirement rates_within(const Array& limits, double excess, double margin, double interest,
                         double step) {
  const auto made = std::make_shared<RatesWithin>();
  made->limits = values(limits, "limits", {kAny});
  made->excess = checked(excess, "excess");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  made->step = checked(step, "step");
  return made;
}

Requirement attitude_within(const Array& chaser_to_base, double limit, double interest) {
  const auto made = std::make_shared<AttitudeWithin>();
  made->chaser_to_base = matrix3(chaser_to_base, "rotation_chaser_to_base");
  made->limit = checked(limit, "limit");
  made->interest = checked(interest, "interest");
  return made;
}

Requirement singular_value_above(const std::vector<int>& movable, double margin, double interest) {
  const auto made = std::make_shared<SingularValueAbove>();
  made->movable = ones_at(movable);
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  return made;
}

Margins margins(double margin, const Array& room, double little, double gained) {
  return {checked(margin, "margin"), values(room, "room", {kAny}), checked(little, "little"),
          checked(gained, "gained")};
}

template <typename Kept>
std::shared_ptr<Kept> distances_kept(const Margins& margins, const Array& times, double interest,
                                     bool quarter_way, size_t pairs) {
  const auto made = std::make_shared<Kept>();
  if (static_cast<size_t>(margins.room.size()) != pairs)
    throw std::invalid_argument("room has " + std::to_string(margins.room.size()) +
                                " numbers, and there are " + std::to_string(pairs) + " pairs");
  made->margins = margins;
  made->times = values(times, "times", {kAny});
  made->interest = checked(interest, "interest");
  made->quarter_way = quarter_way;
  return made;
}

template <typename Held>
auto all_of(const std::shared_ptr<Held>& held) {
  return std::shared_ptr<const std::remove_reference_t<decltype(held->all)>>(held, &held->all);
}

Requirement lines_clear(const std::shared_ptr<Spheres>& spheres, const Margins& margins,
                        size_t lines, const Array& times, double interest, bool quarter_way) {
  const auto made = distances_kept<LinesClearOfSpheres>(margins, times, interest, quarter_way,
                                                        lines * spheres->all.size());
  made->spheres = all_of(spheres);
  return made;
}

Requirement clear_of_spheres(const std::shared_ptr<Bodies>& bodies,
                             const std::shared_ptr<Spheres>& spheres, const Margins& margins,
                             const Array& times, double interest, bool quarter_way) {
  const auto made = distances_kept<BodiesClearOfSpheres>(
      margins, times, interest, quarter_way, bodies->bodies.size() * spheres->all.size());
  made->bodies = bodies;
  made->spheres = all_of(spheres);
  return made;
}

Requirement clear_of_obstacles(const std::shared_ptr<Bodies>& bodies,
                               const std::shared_ptr<Obstacles>& obstacles, const Margins& margins,
                               const Array& times, double interest, bool quarter_way) {
  const auto made = distances_kept<BodiesClearOfObstacles>(
      margins, times, interest, quarter_way, bodies->bodies.size() * obstacles->all.size());
  made->bodies = bodies;
  made->obstacles = all_of(obstacles);
  return made;
}

Requirement pairs_apart(const std::shared_ptr<Bodies>& bodies, const Array& margins,
                        double interest, bool quarter_way) {
  const auto made = std::make_shared<PairsApart>();
  made->bodies = bodies;
  made->margins = values(margins, "margins", {static_cast<py::ssize_t>(bodies->pairs.size())});
  made->interest = checked(interest, "interest");
  made->quarter_way = quarter_way;
  return made;
}

}  // namespace

void bind_path_requirements(py::module_& m) {
  py::class_<Margins>(m, "Margins")
      .def(py::init(&margins), py::arg("margin"), py::arg("room"), py::arg("little"),
           py::arg("gained"));
  py::class_<PathRequirement, Requirement>(m, "PathRequirement");
  m.def("positions_within", &positions_within, py::arg("lower"), py::arg("upper"),
        py::arg("excess"), py::arg("margin"), py::arg("interest"), py::arg("stop_interest"),
        py::arg("jerk"), py::arg("step"));
  m.def("rates_within", &rates_within, py::arg("limits"), py::arg("excess"), py::arg("margin"),
        py::arg("interest"), py::arg("step"));
  m.def("attitude_within", &attitude_within, py::arg("rotation_chaser_to_base"), py::arg("limit"),
        py::arg("interest"));
  m.def("singular_value_above", &singular_value_above, py::arg("rows"), py::arg("margin"),
        py::arg("interest"));
  m.def("lines_clear_of_spheres", &lines_clear, py::arg("spheres"), py::arg("margins"),
        py::arg("lines"), py::arg("times"), py::arg("interest"), py::arg("quarter_way"));
  m.def("bodies_clear_of_spheres", &clear_of_spheres, py::arg("bodies"), py::arg("spheres"),
        py::arg("margins"), py::arg("times"), py::arg("interest"), py::arg("quarter_way"));
  m.def("bodies_clear_of_obstacles", &clear_of_obstacles, py::arg("bodies"), py::arg("obstacles"),
        py::arg("margins"), py::arg("times"), py::arg("interest"), py::arg("quarter_way"));
  m.def("pairs_apart", &pairs_apart, py::arg("bodies"), py::arg("margins"), py::arg("interest"),
        py::arg("quarter_way"));
}

}  // namespace ff
