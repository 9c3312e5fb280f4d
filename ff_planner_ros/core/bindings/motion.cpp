// Python's way to the chain, to its velocity map and to motions of both families.

#include <limits>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "kinematics/held_momentum.hpp"
#include "kinematics/singular_values.hpp"
#include "kinematics/velocity_map.hpp"
#include "program/end_effector_paths.hpp"
#include "program/joint_splines.hpp"

namespace ff {
namespace {

Chain chain(const Array& translations, const Array& rotations, const Array& axes,
            const Array& slides, const Array& weights, const Array& masses, const Array& centers,
            const Array& inertias) {
  const Rows axis = rows(axes, "axes", {kAny, 3});
  const py::ssize_t n = axis.rows();
  if (n < 1 || n > kMaxJoints)
    throw std::invalid_argument("a chain has 1 to " + std::to_string(kMaxJoints) + " joints, not " +
                                std::to_string(n));
  const Rows translation = rows(translations, "translations", {n + 1, 3});
  const Rows rotation = rows(rotations, "rotations", {n + 1, 3, 3});
  const Rows slide = rows(slides, "slides", {n, 3});
  const Values weight = values(weights, "weights", {n});
  if (!(weight.array() >= 1e-6).all() || !(weight.array() <= 1e6).all())
    throw std::invalid_argument("weights must be from 1e-6 to 1e6");
  const Values mass = values(masses, "masses", {n + 1});
  const Rows center = rows(centers, "centers", {n + 1, 3});
  const Rows inertia = rows(inertias, "inertias", {n + 1, 3, 3});
  const auto placement = [&](py::ssize_t k) {
    return Pose{translation.row(k), rotation.middleRows<3>(3 * k)};
  };
  Chain chain;
  for (py::ssize_t k = 0; k < n; ++k) {
    chain.placements.push_back(placement(k));
    chain.axes.push_back(axis.row(k));
    chain.slides.push_back(slide.row(k));
  }
  chain.weights = weight;
  for (py::ssize_t k = 0; k <= n; ++k) {
    chain.masses.push_back(mass[k]);
    chain.centers.push_back(center.row(k));
    chain.inertias.push_back(inertia.middleRows<3>(3 * k));
  }
  chain.tip = placement(n);
  return chain;
}

// Returns v and its derivatives by q, by the twist and by the bias; None in a dynamic singularity.
py::object velocity(const Chain& chain, const Array& q, const Array& momentum, const Array& twist,
                    const Array& bias, double damping) {
  const int n = chain.joints(), size = 6 + n;
  const VelocityMap map(chain, Configuration::read(values(q, "q", {7 + n})),
                        vector6(momentum, "momentum"), vector6(twist, "twist_ee_in_inertial"),
                        values(bias, "bias", {n}), checked(damping, "damping"));
  if (!map.regular) return py::none();
  const VelocityDerivative derivative(map);
  const RowMajor by_q_and_twist = derivative.by_configuration_and_twist();
  RowMajor by_bias(size, n);
  for (int k = 0; k < n; ++k) by_bias.col(k) = derivative.along_bias(Joints::Unit(n, k));
  return py::make_tuple(result(Array(size, map.v.data()), "v"),
                        result(by_q_and_twist.leftCols(size), "dv/dq"),
                        result(by_q_and_twist.rightCols(6), "dv/dtwist"), result(by_bias, "dv/dz"));
}

// Returns the smallest singular values at some joint positions, and their derivatives by these.
py::tuple smallest_singular_values(const Chain& chain, const Array& joints,
                                   const std::vector<int>& movable_rows, double interest) {
  const py::ssize_t n = chain.joints();
  const Rows at = rows(joints, "joints", {kAny, n});
  const Vector6 movable = ones_at(movable_rows);
  std::vector<double> values;
  RowMajor by_joints(at.rows(), n);
  for (py::ssize_t i = 0; i < at.rows(); ++i) {
    const SingularValue found = smallest_singular_value(chain, at.row(i), movable, interest);
    values.push_back(found.value);
    by_joints.row(i) = found.by_joints;
  }
  return py::make_tuple(result(values, {at.rows()}, "values"), result(by_joints, "by_joints"));
}

// Returns angular momenta and torques of a base that does not turn, and the derivatives of both.
py::tuple held_momenta(const Chain& chain, const Array& q, const Array& v,
                       const Array& accelerations, const Array& dq, const Array& dv,
                       const Array& d_accelerations) {
  const py::ssize_t n = chain.joints(), size = 6 + n;
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  const py::ssize_t points = of_q.rows();
  const Rows of_v = rows(v, "v", {points, size});
  const Rows accelerated = rows(accelerations, "accelerations", {points, n});
  const Rows by_q = rows(dq, "q_by_x", {points, size, kAny});
  const py::ssize_t variables = by_q.cols(), xyz = 3;
  const Rows by_v = rows(dv, "v_by_x", {points, size, variables});
  const Rows by_a = rows(d_accelerations, "accelerations_by_x", {points, n, variables});
  Array momenta({points, xyz}), torques({points, xyz});
  Array momenta_by({points, xyz, variables}), torques_by({points, xyz, variables});
  RowsToFill momentum = rows_to_fill(momenta), torque = rows_to_fill(torques);
  RowsToFill momentum_by = rows_to_fill(momenta_by), torque_by = rows_to_fill(torques_by);
  for (py::ssize_t i = 0; i < points; ++i) {
    const HeldMomentum at(Posture(chain, of_q.row(i).tail(n)), of_v.row(i).tail(n),
                          accelerated.row(i));
    const auto joints = by_q.middleRows(size * i + 6, n), rates = by_v.middleRows(size * i + 6, n);
    momentum.row(i) = at.momentum;
    torque.row(i) = at.torque;
    momentum_by.middleRows<3>(3 * i).noalias() =
        at.momentum_by_joints * joints + at.momentum_by_rates * rates;
    torque_by.middleRows<3>(3 * i).noalias() = at.torque_by_joints * joints +
                                               at.torque_by_rates * rates +
                                               at.momentum_by_rates * by_a.middleRows(n * i, n);
  }
  return py::make_tuple(result(momenta, "momenta"), result(momenta_by, "d momenta / dx"),
                        result(torques, "torques"), result(torques_by, "d torques / dx"));
}

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

// by_duration: of angles and rates at half steps, and of the accelerations at the end, a row each.
// target_by_duration: place, twist and acceleration. Both are empty where the duration is given.
py::tuple sensitivity(const DrivenMotion& motion, const Array& angle_rows, const Array& rate_rows,
                      const Array& acceleration_row, const Target& target, const Array& by_duration,
                      const Array& target_by_duration) {
  const py::ssize_t points = motion.q.rows(), size = motion.v.cols(), joints = size - 6;
  const py::ssize_t half_steps = 2 * points - 1;
  const Rows last = rows(acceleration_row, "acceleration_row", {kAny});
  const Shape shape{half_steps, last.cols()};
  JointRows of_joints{rows(angle_rows, "angle_rows", shape), rows(rate_rows, "rate_rows", shape),
                      last, static_cast<int>(joints)};
  TargetChange of_target;
  if (by_duration.size() > 0) {
    const Rows all = rows(by_duration, "by_duration", {2 * half_steps + 1, joints});
    of_joints.angles_by_duration = all.topRows(half_steps);
    of_joints.rates_by_duration = all.middleRows(half_steps, half_steps);
    of_joints.last_acceleration_by_duration = all.bottomRows(1);
    of_target = target_change(rows(target_by_duration, "target_by_duration", {3, 6}));
  }
  const py::ssize_t variables = of_joints.variables();
  const auto conditions = static_cast<py::ssize_t>(motion.goal_error(target).size());
  Array q({points, size, variables}), v({points, size, variables});
  Array q_half_way({points - 1, size, variables}), acceleration({points, size});
  Array goal_error({conditions, variables});
  motion.sensitivity(of_joints, target, of_target,
                     {rows_to_fill(q), rows_to_fill(v), rows_to_fill(q_half_way),
                      rows_to_fill(goal_error), rows_to_fill(acceleration)});
  return py::make_tuple(result(q, "dq/dx"), result(v, "dv/dx"),
                        result(q_half_way, "dq/dx half-way"),
                        result(goal_error, "d(goal error)/dx"), result(acceleration, "dv/dt"));
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

Coefficients coefficients(const Array& x) {
  return Eigen::Map<const Coefficients>(values(x, "x", {kParameters}).data());
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

// Returns the time of a dynamic singularity, or a tuple: q, v, q half-way; the derivatives of all
// three; dv/dt.
py::object end_effector_motion(const Chain& chain, const Array& q_start, const Array& momentum,
                               const EndEffectorPolynomial& path, const NullSpaceFade& null_space,
                               const Array& x, int points, double damping) {
  const EndEffectorRollout motion =
      rollout(chain, q_start, momentum, path, null_space, points, damping);
  const py::ssize_t size = 6 + chain.joints(), variables = motion.variables();
  const py::ssize_t rows = points, gaps = points - 1;
  Array q({rows, 1 + size}), v({rows, size}), q_half_way({gaps, 1 + size});
  Array dq({rows, size, variables}), dv({rows, size, variables});
  Array dq_half_way({gaps, size, variables}), acceleration({rows, size});
  const int singular =
      motion.run(coefficients(x),
                 {rows_to_fill(q), rows_to_fill(v), rows_to_fill(q_half_way), rows_to_fill(dq),
                  rows_to_fill(dv), rows_to_fill(dq_half_way), rows_to_fill(acceleration)});
  if (singular != kRegular) return py::float_(singular / (2.0 * gaps) * path.duration);
  return py::make_tuple(result(q, "q"), result(v, "v"), result(q_half_way, "q_half_way"),
                        result(dq, "dq"), result(dv, "dv"), result(dq_half_way, "dq_half_way"),
                        result(acceleration, "acceleration"));
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
  m.attr("MAX_JOINTS") = kMaxJoints;
  py::class_<Chain>(m, "Chain")
      .def(py::init(&chain), py::arg("translations"), py::arg("rotations"), py::arg("axes"),
           py::arg("slides"), py::arg("weights"), py::arg("masses"), py::arg("centers"),
           py::arg("inertias"))
      .def_property_readonly("joints", &Chain::joints);
  m.def("velocity", &velocity, py::arg("chain"), py::arg("q"), py::arg("momentum"),
        py::arg("twist_ee_in_inertial"), py::arg("bias"), py::arg("damping"));
  m.def("smallest_singular_values", &smallest_singular_values, py::arg("chain"), py::arg("joints"),
        py::arg("rows"), py::arg("interest") = std::numeric_limits<double>::infinity());
  m.def("held_momenta", &held_momenta, py::arg("chain"), py::arg("q"), py::arg("v"),
        py::arg("accelerations"), py::arg("q_by_x"), py::arg("v_by_x"),
        py::arg("accelerations_by_x"));
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
      .def("sensitivity", &sensitivity, py::arg("angle_rows"), py::arg("rate_rows"),
           py::arg("acceleration_row"), py::arg("target"), py::arg("by_duration") = Array(0),
           py::arg("target_by_duration") = Array(0));
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
  m.def("end_effector_motion", &end_effector_motion, py::arg("chain"), py::arg("q_start"),
        py::arg("momentum"), py::arg("path"), py::arg("null_space"), py::arg("x"),
        py::arg("points"), py::arg("damping"));
  m.def("end_effector_paths", &end_effector_paths, py::arg("chain"), py::arg("q_start"),
        py::arg("momentum"), py::arg("path"), py::arg("null_space"), py::arg("points"),
        py::arg("damping"), py::arg("goal_by_duration") = Array(0));
}

}  // namespace ff
