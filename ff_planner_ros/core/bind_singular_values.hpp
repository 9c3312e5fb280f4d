// Python's way to the smallest singular values of the generalised Jacobian.
#pragma once
#include <pybind11/stl.h>

#include "arrays.hpp"
#include "singular_values.hpp"

namespace ff {

// Returns them at each of some joint positions, and their derivatives by these.
inline py::tuple smallest_singular_values(const Chain& chain, const Array& joints,
                                          const std::vector<int>& rows) {
  const py::ssize_t n = chain.joints();
  const double* of_joints = checked(joints, "joints", {kAny, n});
  Vector6 movable = Vector6::Zero();
  for (const int row : rows) {
    if (row < 0 || row > 5) throw std::invalid_argument("rows are numbers from 0 to 5");
    movable[row] = 1;
  }
  const py::ssize_t count = joints.shape(0);
  Array values(count), by_joints({count, n});
  for (py::ssize_t i = 0; i < count; ++i) {
    const SingularValue found =
        smallest_singular_value(chain, Eigen::Map<const Joints>(of_joints + i * n, n), movable);
    values.mutable_data()[i] = found.value;
    Eigen::Map<Joints>(by_joints.mutable_data() + i * n, n) = found.by_joints;
  }
  return py::make_tuple(result(values, "values"), result(by_joints, "by_joints"));
}

inline void bind_singular_values(py::module_& m) {
  m.def("smallest_singular_values", &smallest_singular_values, py::arg("chain"), py::arg("joints"),
        py::arg("rows"));
}

}  // namespace ff
