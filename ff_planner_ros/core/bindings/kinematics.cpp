// Python's way to the chain, to its velocity map and to what wheels hold of it.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "kinematics/held_momentum.hpp"
#include "kinematics/velocity_map.hpp"

namespace ff {
namespace {

std::shared_ptr<const Tree> tree(const std::vector<int>& before, const std::vector<int>& planned,
                                 const Array& multipliers, const Array& offsets, int tip) {
  const auto n = static_cast<int>(before.size());
  if (n < 1 || n > kMaxJoints)
    throw std::invalid_argument("a chain has 1 to " + std::to_string(kMaxJoints) + " joints, not " +
                                std::to_string(n));
  if (planned.size() != before.size())
    throw std::invalid_argument("planned must have a number for each joint");
  const Values multiplier = values(multipliers, "multipliers", {n});
  const Values offset = values(offsets, "offsets", {n});
  std::vector<Tree::Drive> drives;
  int count = 0;
  for (int k = 0; k < n; ++k) {
    if (before[k] < 0 || before[k] > k || planned[k] < 0 || planned[k] >= n)
      throw std::invalid_argument("joint " + std::to_string(k) + " is of another tree");
    drives.push_back({planned[k], multiplier[k], offset[k]});
    count = std::max(count, planned[k] + 1);
  }
  if (tip < 1 || tip > n) throw std::invalid_argument("tip must be a body that a joint moves");
  return std::make_shared<const Tree>(before, drives, count, tip);
}

Chain chain(const Array& translations, const Array& rotations, const Array& axes,
            const Array& slides, const Array& weights, const Array& masses, const Array& centers,
            const Array& inertias, const std::vector<int>& before, const std::vector<int>& planned,
            const Array& multipliers, const Array& offsets, int tip) {
  Chain chain;
  chain.tree = tree(before, planned, multipliers, offsets, tip);
  const py::ssize_t n = chain.tree->joints();
  const Rows axis = rows(axes, "axes", {n, 3});
  const Rows translation = rows(translations, "translations", {n + 1, 3});
  const Rows rotation = rows(rotations, "rotations", {n + 1, 3, 3});
  const Rows slide = rows(slides, "slides", {n, 3});
  const Values weight = values(weights, "weights", {chain.joints()});
  if (!(weight.array() >= 1e-6).all() || !(weight.array() <= 1e6).all())
    throw std::invalid_argument("weights must be from 1e-6 to 1e6");
  const Values mass = values(masses, "masses", {n + 1});
  const Rows center = rows(centers, "centers", {n + 1, 3});
  const Rows inertia = rows(inertias, "inertias", {n + 1, 3, 3});
  const auto placement = [&](py::ssize_t k) {
    return Pose{translation.row(k), rotation.middleRows<3>(3 * k)};
  };
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

// Returns v and its derivatives by q and by the twist; None in a dynamic singularity.
py::object velocity(const Chain& chain, const Array& q, const Array& momentum, const Array& twist,
                    const Array& bias, double damping) {
  const int n = chain.joints(), size = 6 + n;
  const VelocityMap map(chain, Configuration::read(values(q, "q", {7 + n})),
                        vector6(momentum, "momentum"), vector6(twist, "twist_ee_in_inertial"),
                        values(bias, "bias", {n}), checked(damping, "damping"));
  if (!map.regular) return py::none();
  const VelocityDerivative derivative(map);
  const RowMajor by_q_and_twist = derivative.by_configuration_and_twist();
  return py::make_tuple(result(Array(size, map.v.data()), "v"),
                        result(by_q_and_twist.leftCols(size), "dv/dq"),
                        result(by_q_and_twist.rightCols(6), "dv/dtwist"));
}

// Returns angular momenta and torques of a base that does not turn.
py::tuple held_momenta(const Chain& chain, const Array& q, const Array& v,
                       const Array& accelerations) {
  const py::ssize_t n = chain.joints();
  const Rows of_q = rows(q, "q", {kAny, 7 + n});
  const py::ssize_t points = of_q.rows();
  const Rows of_v = rows(v, "v", {points, 6 + n});
  const Rows accelerated = rows(accelerations, "accelerations", {points, n});
  RowMajor momenta(points, 3), torques(points, 3);
  for (py::ssize_t i = 0; i < points; ++i) {
    const HeldMomentum at(Posture(chain, of_q.row(i).tail(n)), of_v.row(i).tail(n),
                          accelerated.row(i));
    momenta.row(i) = at.momentum;
    torques.row(i) = at.torque;
  }
  return py::make_tuple(result(momenta, "momenta"), result(torques, "torques"));
}

}  // namespace

void bind_kinematics(py::module_& m) {
  m.attr("MAX_JOINTS") = kMaxJoints;
  py::class_<Chain>(m, "Chain")
      .def(py::init(&chain), py::arg("translations"), py::arg("rotations"), py::arg("axes"),
           py::arg("slides"), py::arg("weights"), py::arg("masses"), py::arg("centers"),
           py::arg("inertias"), py::arg("before"), py::arg("planned"), py::arg("multipliers"),
           py::arg("offsets"), py::arg("tip"))
      .def_property_readonly("joints", &Chain::joints);
  m.def("velocity", &velocity, py::arg("chain"), py::arg("q"), py::arg("momentum"),
        py::arg("twist_ee_in_inertial"), py::arg("bias"), py::arg("damping"));
  m.def("held_momenta", &held_momenta, py::arg("chain"), py::arg("q"), py::arg("v"),
        py::arg("accelerations"));
}

}  // namespace ff
