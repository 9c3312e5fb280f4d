// The border to Python: no array of a wrong size and no NaN crosses it, in either direction.
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "chain.hpp"

namespace ff {

namespace py = pybind11;
// Numbers that are none of these without a loss, as 1.5 or 1j may be, are refused by TypeError.
using Array = py::array_t<double, py::array::c_style>;
using Numbers = py::array_t<long long, py::array::c_style>;
using Shape = std::vector<py::ssize_t>;

constexpr py::ssize_t kAny = -1;  // a size that any array may have

inline std::string written(const Shape& shape) {
  std::string text = "(";
  for (const py::ssize_t size : shape) text += (size == kAny ? "any" : std::to_string(size)) + ", ";
  return text + ")";
}

inline bool all_finite(const Array& array) {
  return Eigen::Map<const Eigen::VectorXd>(array.data(), array.size()).allFinite();
}

// These throw ValueError of Python where an argument is not as expected.
inline void require_shape(const py::array& array, const char* name, const Shape& expected) {
  const Shape shape(array.shape(), array.shape() + array.ndim());
  bool as_expected = shape.size() == expected.size();
  for (size_t i = 0; as_expected && i < shape.size(); ++i)
    as_expected = expected[i] == kAny || expected[i] == shape[i];
  if (!as_expected)
    throw std::invalid_argument(std::string(name) + " has the shape " + written(shape) + ", not " +
                                written(expected));
}

// Returns what an argument points to.
inline const double* checked(const Array& array, const char* name, const Shape& expected) {
  require_shape(array, name, expected);
  if (!all_finite(array)) throw std::invalid_argument(std::string(name) + " is not finite");
  return array.data();
}

inline double checked(double value, const char* name) {
  if (!std::isfinite(value)) throw std::invalid_argument(std::string(name) + " is not finite");
  return value;
}
inline const long long* checked(const Numbers& array, const char* name, const Shape& expected) {
  require_shape(array, name, expected);
  return array.data();
}

// Returns a result; throws where the core computed what is no number.
inline Array result(const Array& array, const char* name) {
  if (!all_finite(array)) throw std::domain_error(std::string(name) + " is not finite");
  return array;
}
inline double result(double value, const char* name) {
  if (!std::isfinite(value)) throw std::domain_error(std::string(name) + " is not finite");
  return value;
}

template <typename Derived>
Array result(const Eigen::DenseBase<Derived>& matrix, const char* name) {
  Array array({matrix.rows(), matrix.cols()});
  Eigen::Map<RowMajor>(array.mutable_data(), matrix.rows(), matrix.cols()) = matrix;
  return result(array, name);
}

inline Vector3 vector3(const double* from) { return Eigen::Map<const Vector3>(from); }
inline Vector6 vector6(const double* from) { return Eigen::Map<const Vector6>(from); }
inline Matrix3 matrix3(const double* from) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(from);
}

}  // namespace ff
