// Python's way to the chain and to the velocity map at one configuration.
#pragma once
#include "arrays.hpp"
#include "velocity_map.hpp"

namespace ff {

inline Chain chain(const Array& translations, const Array& rotations, const Array& axes,
                   const Array& masses, const Array& centers, const Array& inertias) {
  const double* axis = checked(axes, "axes", {kAny, 3});
  const py::ssize_t n = axes.shape(0);
  if (n < 1 || n > kMaxJoints)
    throw std::invalid_argument("a chain has 1 to " + std::to_string(kMaxJoints) + " joints, not " +
                                std::to_string(n));
  const double* translation = checked(translations, "translations", {n + 1, 3});
  const double* rotation = checked(rotations, "rotations", {n + 1, 3, 3});
  const double* mass = checked(masses, "masses", {n + 1});
  const double* center = checked(centers, "centers", {n + 1, 3});
  const double* inertia = checked(inertias, "inertias", {n + 1, 3, 3});
  Chain chain;
  for (py::ssize_t k = 0; k < n; ++k) {
    chain.placements.push_back({vector3(translation + 3 * k), matrix3(rotation + 9 * k)});
    chain.axes.push_back(vector3(axis + 3 * k));
  }
  for (py::ssize_t k = 0; k <= n; ++k) {
    chain.masses.push_back(mass[k]);
    chain.centers.push_back(vector3(center + 3 * k));
    chain.inertias.push_back(matrix3(inertia + 9 * k));
  }
  chain.tip = {vector3(translation + 3 * n), matrix3(rotation + 9 * n)};
  return chain;
}

// Returns v and its derivatives by q, by the twist and by the bias; None in a dynamic singularity.
inline py::object velocity(const Chain& chain, const Array& q, const Array& momentum,
                           const Array& twist, const Array& bias, double damping) {
  const int n = chain.joints(), size = 6 + n;
  VelocityMap map(chain, Configuration::read(checked(q, "q", {7 + n}), n),
                  vector6(checked(momentum, "momentum", {6})),
                  vector6(checked(twist, "twist_ee_in_inertial", {6})),
                  Eigen::Map<const Joints>(checked(bias, "bias", {n}), n),
                  checked(damping, "damping"));
  if (!map.regular) return py::none();
  map.prepare_derivative();
  Along<Eigen::Dynamic> steps = Along<Eigen::Dynamic>::Identity(size, size + 6);
  Twists<Eigen::Dynamic> twists = Twists<Eigen::Dynamic>::Zero(6, size + 6);
  twists.rightCols<6>().setIdentity();
  const Along<Eigen::Dynamic> derivative = map.along(steps, twists);
  Eigen::MatrixXd by_bias(size, n);
  for (int k = 0; k < n; ++k) by_bias.col(k) = map.along_bias(Joints::Unit(n, k));
  const Eigen::Map<const RowMajor> v(map.v.data(), 1, size);
  return py::make_tuple(result(v, "v").reshape({size}), result(derivative.leftCols(size), "dv/dq"),
                        result(derivative.rightCols<6>(), "dv/dtwist"), result(by_bias, "dv/dz"));
}

inline void bind_chain(py::module_& m) {
  m.attr("MAX_JOINTS") = kMaxJoints;
  py::class_<Chain>(m, "Chain")
      .def(py::init(&chain), py::arg("translations"), py::arg("rotations"), py::arg("axes"),
           py::arg("masses"), py::arg("centers"), py::arg("inertias"))
      .def_property_readonly("joints", &Chain::joints);
  m.def("velocity", &velocity, py::arg("chain"), py::arg("q"), py::arg("momentum"),
        py::arg("twist_ee_in_inertial"), py::arg("bias"), py::arg("damping"));
}

}  // namespace ff
