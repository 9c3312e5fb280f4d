// Python's way to the motion of a system whose joints are driven.
#pragma once
#include "driven_motion.hpp"

#include "arrays.hpp"

namespace ff {

inline RowMajor matrix(const Array& array, const char* name, const Shape& shape) {
  const double* from = checked(array, name, shape);
  return Eigen::Map<const RowMajor>(from, array.shape(0), array.shape(1));
}

inline Start start(const Array& position, const Array& rotation, const Array& center,
                   const Array& momentum, bool planar) {
  const Vector6 conserved = vector6(checked(momentum, "momentum", {6}));
  return {vector3(checked(position, "position", {3})),
          matrix3(checked(rotation, "rotation", {3, 3})),
          vector3(checked(center, "center", {3})),
          conserved.head<3>(),
          conserved.tail<3>(),
          planar};
}

inline Orientation orientation_named(const std::string& name) {
  if (name == "fixed") return Orientation::kFixed;
  if (name == "about_axis") return Orientation::kAboutAxis;
  if (name == "free") return Orientation::kFree;
  throw std::invalid_argument("orientation is " + name + ", not fixed, about_axis or free");
}

inline Target target(const Array& position, const Array& rotation, const Array& twist,
                     const Array& acceleration, const std::string& orientation,
                     const Array& free_axis, const Array& across) {
  const double* axes = checked(across, "across", {2, 3});
  return {vector3(checked(position, "position", {3})),
          matrix3(checked(rotation, "rotation", {3, 3})),
          vector6(checked(twist, "twist", {6})),
          vector6(checked(acceleration, "acceleration", {6})),
          orientation_named(orientation),
          vector3(checked(free_axis, "free_axis", {3})),
          {vector3(axes), vector3(axes + 3)}};
}

inline DrivenMotion driven_motion(const Chain& chain, const Start& start, const Array& angles,
                                  const Array& rates, const Array& accelerations, double duration) {
  const py::ssize_t half_steps = angles.ndim() > 0 ? angles.shape(0) : 0, n = chain.joints();
  if (half_steps < 3 || half_steps % 2 == 0)
    throw std::invalid_argument("angles has " + std::to_string(half_steps) +
                                " rows, not an odd number of three or more");
  return DrivenMotion(chain, start, matrix(angles, "angles", {half_steps, n}),
                      matrix(rates, "rates", {half_steps, n}),
                      matrix(accelerations, "accelerations", {half_steps, n}),
                      checked(duration, "duration"));
}

// by_duration: of angles and rates at half steps, and of the accelerations at the end, a row each.
// target_by_duration: place, twist and acceleration. Both are empty where the duration is given.
inline py::tuple sensitivity(const DrivenMotion& motion, const Array& angle_rows,
                             const Array& rate_rows, const Array& acceleration_row,
                             const Target& target, const Array& by_duration,
                             const Array& target_by_duration) {
  const py::ssize_t points = motion.q.rows(), size = motion.v.cols(), joints = size - 6;
  const double* of_acceleration = checked(acceleration_row, "acceleration_row", {kAny});
  const py::ssize_t each = acceleration_row.size();
  const Shape shape{2 * points - 1, each};
  const auto rows = [&](const Array& array, const char* name) {
    return Eigen::Map<const RowMajor>(checked(array, name, shape), 2 * points - 1, each);
  };
  JointRows of_joints{rows(angle_rows, "angle_rows"),
                      rows(rate_rows, "rate_rows"),
                      static_cast<int>(joints),
                      {},
                      {}};
  Joints accelerations_by_duration = Joints::Zero(joints);
  TargetChange of_target;
  if (by_duration.size() > 0) {
    const py::ssize_t half_steps = shape[0], six = 6;
    const RowMajor all = matrix(by_duration, "by_duration", {2 * half_steps + 1, joints});
    of_joints.angles_by_duration = all.topRows(half_steps);
    of_joints.rates_by_duration = all.middleRows(half_steps, half_steps);
    accelerations_by_duration = all.row(2 * half_steps);
    const double* moved = checked(target_by_duration, "target_by_duration", {3, six});
    of_target = {vector6(moved), vector6(moved + six), vector6(moved + 2 * six), 1};
  }
  const py::ssize_t variables = of_joints.variables();
  const auto conditions = static_cast<py::ssize_t>(motion.goal_error(target).size());
  Array q({points, size, variables}), v({points, size, variables});
  Array q_half_way({points - 1, size, variables}), acceleration({points, size});
  Array goal_error({conditions, variables});
  motion.sensitivity(of_joints, of_acceleration, target, accelerations_by_duration, of_target,
                     {q.mutable_data(), v.mutable_data(), q_half_way.mutable_data(),
                      acceleration.mutable_data(), goal_error.mutable_data()});
  return py::make_tuple(result(q, "dq/dx"), result(v, "dv/dx"),
                        result(q_half_way, "dq/dx half-way"),
                        result(goal_error, "d(goal error)/dx"), result(acceleration, "dv/dt"));
}

inline void bind_driven_motion(py::module_& m) {
  py::class_<Start>(m, "Start")
      .def(py::init(&start), py::arg("position"), py::arg("rotation"), py::arg("center"),
           py::arg("momentum"), py::arg("planar"));
  py::class_<Target>(m, "Target")
      .def(py::init(&target), py::arg("position"), py::arg("rotation"), py::arg("twist"),
           py::arg("acceleration"), py::arg("orientation"), py::arg("free_axis"),
           py::arg("across"));
  py::class_<DrivenMotion>(m, "DrivenMotion")
      .def(py::init(&driven_motion), py::arg("chain"), py::arg("start"), py::arg("angles"),
           py::arg("rates"), py::arg("accelerations"), py::arg("duration"))
      .def_property_readonly("q", [](const DrivenMotion& m) { return result(m.q, "q"); })
      .def_property_readonly("v", [](const DrivenMotion& m) { return result(m.v, "v"); })
      .def_property_readonly(
          "q_half_way", [](const DrivenMotion& m) { return result(m.q_half_way, "q_half_way"); })
      .def(
          "goal_error",
          [](const DrivenMotion& m, const Target& target) {
            const std::vector<double> error = m.goal_error(target);
            return result(Array(error.size(), error.data()), "goal error");
          },
          py::arg("target"))
      .def("sensitivity", &sensitivity, py::arg("angle_rows"), py::arg("rate_rows"),
           py::arg("acceleration_row"), py::arg("target"), py::arg("by_duration") = Array(0),
           py::arg("target_by_duration") = Array(0));
}

}  // namespace ff
