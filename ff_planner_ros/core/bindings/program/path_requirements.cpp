// Python's way to the limits along paths that the core knows.
#include "program/path_requirements.hpp"

#include <pybind11/stl.h>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"

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

Requirement rotation_within(double limit, double knee, double interest) {
  const auto made = std::make_shared<RotationWithin>();
  made->limit = checked(limit, "limit");
  made->knee = checked(knee, "knee");
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

}  // namespace

void bind_path_requirements(py::module_& m) {
  py::class_<PathRequirement, Requirement>(m, "PathRequirement");
  m.def("positions_within", &positions_within, py::arg("lower"), py::arg("upper"),
        py::arg("excess"), py::arg("margin"), py::arg("interest"), py::arg("stop_interest"),
        py::arg("jerk"), py::arg("step"));
  m.def("rates_within", &rates_within, py::arg("limits"), py::arg("excess"), py::arg("margin"),
        py::arg("interest"), py::arg("step"));
  m.def("attitude_within", &attitude_within, py::arg("rotation_chaser_to_base"), py::arg("limit"),
        py::arg("interest"));
  m.def("rotation_within", &rotation_within, py::arg("limit"), py::arg("knee"),
        py::arg("interest"));
  m.def("singular_value_above", &singular_value_above, py::arg("rows"), py::arg("margin"),
        py::arg("interest"));
}

}  // namespace ff
