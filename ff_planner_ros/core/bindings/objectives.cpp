// Python's way to the objectives of a search.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "kinematics/chaser_euler.hpp"
#include "motion/joint_path.hpp"

namespace ff {
namespace {

// Returns value, gradient and Hessian.
py::tuple joint_path(const Array& v, const Array& dv, double step, double slow, double smoothing) {
  const Rows of_v = rows(v, "v", {kAny, kAny});
  const Rows of_dv = rows(dv, "by_x", {of_v.rows(), of_v.cols(), kAny});
  if (of_v.rows() < 2 || of_v.cols() < 7 || of_v.cols() > kMaxVelocities)
    throw std::invalid_argument("v has the shape " + written({of_v.rows(), of_v.cols()}));
  const JointPath path(of_v, of_dv, checked(step, "step"), checked(slow, "slow"),
                       checked(smoothing, "smoothing"));
  return py::make_tuple(result(path.value, "value"),
                        result(Array(path.gradient.size(), path.gradient.data()), "gradient"),
                        result(path.hessian, "hessian"));
}

// Returns the angles and their derivatives.
py::tuple chaser_euler(const Array& q, const Array& dq, const Array& chaser_to_base) {
  const Rows of_q = rows(q, "q", {kAny, kAny});
  if (of_q.cols() < 8 || of_q.cols() > kMaxVelocities + 1)
    throw std::invalid_argument("q has the shape " + written({of_q.rows(), of_q.cols()}));
  const Rows of_dq = rows(dq, "by_x", {of_q.rows(), of_q.cols() - 1, kAny});
  const ChaserEuler found(of_q, of_dq, matrix3(chaser_to_base, "rotation_chaser_to_base"));
  const Shape shape{of_q.rows(), 3, of_dq.cols()};
  return py::make_tuple(result(found.angles, "angles"),
                        result(Array(shape, found.jacobian.data()), "by_x"));
}

}  // namespace

void bind_objectives(py::module_& m) {
  m.def("joint_path", &joint_path, py::arg("v"), py::arg("by_x"), py::arg("step"), py::arg("slow"),
        py::arg("smoothing"));
  m.def("chaser_euler", &chaser_euler, py::arg("q"), py::arg("by_x"),
        py::arg("rotation_chaser_to_base"));
}

}  // namespace ff
