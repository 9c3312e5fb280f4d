// Python's way to the motions of both families.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "program/end_effector_paths.hpp"
#include "program/joint_splines.hpp"

namespace ff {
namespace {

Start start(const Array& position, const Array& rotation, const Array& center,
            const Array& momentum, const std::string& base) {
  const Vector6 conserved = vector6(momentum, "momentum");
  return {vector3(position, "position"), matrix3(rotation, "rotation"), vector3(center, "center"),
          conserved.head<3>(),           conserved.tail<3>(),           base_named(base)};
}

Orientation orientation_named(const std::string& name) {
  if (name == "fixed") return Orientation::kFixed;
  if (name == "about_axis") return Orientation::kAboutAxis;
  if (name == "free") return Orientation::kFree;
  throw std::invalid_argument("orientation is " + name + ", not fixed, about_axis or free");
}

Target target(const Array& position, const Array& rotation, const Array& twist,
              const Array& acceleration, const std::string& orientation, const Array& free_axis,
              const Array& across) {
  const Rows axes = rows(across, "across", {2, 3});
  return {vector3(position, "position"),  matrix3(rotation, "rotation"),
          vector6(twist, "twist"),        vector6(acceleration, "acceleration"),
          orientation_named(orientation), vector3(free_axis, "free_axis"),
          {axes.row(0), axes.row(1)}};
}

DrivenMotion driven_motion(const Chain& chain, const Start& start, const Array& angles,
                           const Array& rates, const Array& accelerations, double duration) {
  const py::ssize_t half_steps = angles.ndim() > 0 ? angles.shape(0) : 0, n = chain.joints();
  if (half_steps < 3 || half_steps % 2 == 0)
    throw std::invalid_argument("angles has " + std::to_string(half_steps) +
                                " rows, not an odd number of three or more");
  return DrivenMotion(
      chain, start, rows(angles, "angles", {half_steps, n}), rows(rates, "rates", {half_steps, n}),
      rows(accelerations, "accelerations", {half_steps, n}), checked(duration, "duration"));
}

TargetChange target_change(const Rows& by_duration) {
  return {by_duration.row(0), by_duration.row(1), by_duration.row(2), 1};
}

// Returns the derivatives of the goal error by the variables.
Array goal_error_by_x(const DrivenMotion& motion, const Array& angle_rows, const Array& rate_rows,
                      const Array& acceleration_row, const Target& target) {
  const py::ssize_t points = motion.q.rows(), size = motion.v.cols();
  const Rows last = rows(acceleration_row, "acceleration_row", {kAny});
  const Shape shape{2 * points - 1, last.cols()};
  const JointRows of_joints{rows(angle_rows, "angle_rows", shape),
                            rows(rate_rows, "rate_rows", shape), last, static_cast<int>(size) - 6};
  const Eigen::Index variables = of_joints.variables();
  RowMajor q(points * size, variables), v(points * size, variables);
  RowMajor q_half_way((points - 1) * size, variables), acceleration(points, size);
  RowMajor goal_error(motion.goal_error(target).size(), variables);
  const auto all = [](RowMajor& of) { return from_row(of, 0, of.rows()); };
  motion.sensitivity(of_joints, target, TargetChange(),
                     {all(q), all(v), all(q_half_way), all(goal_error), all(acceleration)});
  return result(goal_error, "d(goal error)/dx");
}

SplineRows spline_rows(const Array& free, const Array& known, const Array& moved) {
  const Rows by_variables = rows(free, "free", {kAny, kAny});
  const Rows of_ends = rows(known, "known", {by_variables.rows(), kAny});
  SplineRows found{by_variables, of_ends, RowMajor()};
  if (moved.size() > 0) found.moved = rows(moved, "moved", {of_ends.rows(), of_ends.cols()});
  return found;
}

std::shared_ptr<PathsOnGrid> joint_splines(
    const Chain& chain, const Start& start, const Target& target, bool has_goal, double duration,
    const SplineRows& positions, const SplineRows& rates, const SplineRows& accelerations,
    const SplineRows& position_hull, const SplineRows& rate_hull, const Array& target_by_duration) {
  const Eigen::Index half_steps = positions.free.rows(), each = positions.free.cols();
  if (half_steps < 3 || half_steps % 2 == 0)
    throw std::invalid_argument("positions has " + std::to_string(half_steps) +
                                " rows, not an odd number of three or more");
  for (const SplineRows* of : {&rates, &accelerations})
    if (of->free.rows() != half_steps)
      throw std::invalid_argument("rates or accelerations are at other half steps");
  const bool has_duration = target_by_duration.size() > 0;
  for (const SplineRows* of : {&positions, &rates, &accelerations, &position_hull, &rate_hull}) {
    if (of->free.cols() != each || of->known.cols() != chain.joints())
      throw std::invalid_argument("rows are of other variables, or of another chain");
    if (of->has_duration() != has_duration)
      throw std::invalid_argument("rows and target must both move with the duration, or neither");
  }
  std::optional<TargetChange> moved;
  if (has_duration) moved = target_change(rows(target_by_duration, "target_by_duration", {3, 6}));
  return std::make_shared<JointSplinesOnGrid>(
      chain, start, target, has_goal, checked(duration, "duration"),
      SplineGrid{positions, rates, accelerations, position_hull, rate_hull}, moved);
}

EndEffectorPolynomial end_effector_polynomial(double duration, const Array& quintic,
                                              const Array& rotation_outer,
                                              const Array& quintic_by_duration) {
  if (!(checked(duration, "duration") > 0))
    throw std::invalid_argument("duration must be positive");
  EndEffectorPolynomial path{duration, rows(quintic, "quintic", {6, 6}),
                             matrix3(rotation_outer, "rotation_outer")};
  if (quintic_by_duration.size() > 0)
    path.quintic_by_duration = rows(quintic_by_duration, "quintic_by_duration", {6, 6});
  return path;
}

NullSpaceFade null_space_fade(const Array& rates, const Array& accelerations, double seconds) {
  if (!(checked(seconds, "seconds") > 0)) throw std::invalid_argument("seconds must be positive");
  const py::ssize_t joints = rates.ndim() > 0 ? rates.shape(0) : 0;
  if (joints > kMaxJoints) throw std::invalid_argument("rates has the shape " + written({joints}));
  return {values(rates, "rates", {joints}), values(accelerations, "accelerations", {joints}),
          seconds};
}

EndEffectorRollout rollout(const Chain& chain, const Array& q_start, const Array& momentum,
                           const EndEffectorPolynomial& path, const NullSpaceFade& null_space,
                           int points, double damping) {
  const py::ssize_t n = chain.joints();
  if (points < 2) throw std::invalid_argument("points must be 2 or more");
  if (null_space.rates.size() != n) throw std::invalid_argument("null_space is of another chain");
  return {chain,
          Configuration::read(values(q_start, "q_start", {7 + n})),
          vector6(momentum, "momentum"),
          path,
          null_space,
          points,
          checked(damping, "damping")};
}

// Returns the time of a dynamic singularity, or q, v, q half-way and the goal error.
py::object motion_of(const PathsOnGrid& paths, const Array& x) {
  PathDerivatives by_x;
  const PathMotion found = paths.motion(values(x, "x", {paths.variables()}), by_x);
  if (!found.is_regular()) return py::float_(found.singular_at);
  const Eigen::Index points = found.points();
  return py::make_tuple(
      result(found.q.topRows(points), "q"), result(found.v, "v"),
      result(found.q.bottomRows(points - 1), "q_half_way"),
      result(Array(found.goal_error.size(), found.goal_error.data()), "goal error"));
}

std::shared_ptr<PathsOnGrid> end_effector_paths(const Chain& chain, const Array& q_start,
                                                const Array& momentum,
                                                const EndEffectorPolynomial& path,
                                                const NullSpaceFade& null_space, int points,
                                                double damping, const Array& goal_by_duration) {
  std::optional<Vector6> goal_moves;
  if (goal_by_duration.size() > 0) goal_moves = vector6(goal_by_duration, "goal_by_duration");
  if (path.quintic_by_duration.has_value() != goal_moves.has_value())
    throw std::invalid_argument("path and goal must both move with the duration, or neither");
  return std::make_shared<EndEffectorPathsOnGrid>(
      rollout(chain, q_start, momentum, path, null_space, points, damping), goal_moves);
}

}  // namespace

void bind_motion(py::module_& m) {
  py::class_<PathsOnGrid, std::shared_ptr<PathsOnGrid>>(m, "PathsOnGrid")
      .def("motion", &motion_of, py::arg("x"));
  py::class_<Start>(m, "Start")
      .def(py::init(&start), py::arg("position"), py::arg("rotation"), py::arg("center"),
           py::arg("momentum"), py::arg("base"));
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
      .def("goal_error_by_x", &goal_error_by_x, py::arg("angle_rows"), py::arg("rate_rows"),
           py::arg("acceleration_row"), py::arg("target"));
  py::class_<SplineRows>(m, "SplineRows")
      .def(py::init(&spline_rows), py::arg("free"), py::arg("known"), py::arg("moved") = Array(0));
  m.def("joint_splines", &joint_splines, py::arg("chain"), py::arg("start"), py::arg("target"),
        py::arg("has_goal"), py::arg("duration"), py::arg("positions"), py::arg("rates"),
        py::arg("accelerations"), py::arg("position_hull"), py::arg("rate_hull"),
        py::arg("target_by_duration") = Array(0));
  py::class_<EndEffectorPolynomial>(m, "EndEffectorPolynomial")
      .def(py::init(&end_effector_polynomial), py::arg("duration"), py::arg("quintic"),
           py::arg("rotation_outer"), py::arg("quintic_by_duration") = Array(0));
  py::class_<NullSpaceFade>(m, "NullSpaceFade")
      .def(py::init(&null_space_fade), py::arg("rates"), py::arg("accelerations"),
           py::arg("seconds"));
  m.def("end_effector_paths", &end_effector_paths, py::arg("chain"), py::arg("q_start"),
        py::arg("momentum"), py::arg("path"), py::arg("null_space"), py::arg("points"),
        py::arg("damping"), py::arg("goal_by_duration") = Array(0));
}

}  // namespace ff
