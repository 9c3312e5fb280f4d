// Python's way to the chain, to its velocity map and to singular values.
#include <limits>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "kinematics/held_momentum.hpp"
#include "kinematics/singular_values.hpp"
#include "kinematics/velocity_map.hpp"

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

}  // namespace

void bind_kinematics(py::module_& m) {
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
}

}  // namespace ff
