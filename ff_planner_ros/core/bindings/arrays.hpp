// The border to Python: no array of a wrong size and no NaN crosses it, in either direction.
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "kinematics/chain.hpp"

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

inline double checked(double value, const char* name) {
  if (!std::isfinite(value)) throw std::invalid_argument(std::string(name) + " is not finite");
  return value;
}

inline Values values(const Array& array) { return {array.data(), array.size()}; }
inline Values values(const Array& array, const char* name, const Shape& expected) {
  require_shape(array, name, expected);
  if (!are_finite(values(array))) throw std::invalid_argument(std::string(name) + " is not finite");
  return values(array);
}

// All axes but the last are rows: an array of matrices has their rows one below the other.
inline Eigen::Index row_count(const Array& array) {
  Eigen::Index count = 1;
  for (py::ssize_t axis = 0; axis + 1 < array.ndim(); ++axis) count *= array.shape(axis);
  return count;
}
inline Rows rows(const Array& array, const char* name, const Shape& expected) {
  return {values(array, name, expected).data(), row_count(array), array.shape(array.ndim() - 1)};
}
inline RowsToFill rows_to_fill(Array& array) {
  return {array.mutable_data(), row_count(array), array.shape(array.ndim() - 1)};
}

inline Matrix3 matrix3(const Array& array, const char* name) { return rows(array, name, {3, 3}); }
inline Vector3 vector3(const Array& array, const char* name) { return values(array, name, {3}); }
inline Vector6 vector6(const Array& array, const char* name) { return values(array, name, {6}); }

// The rows of a twist that count, as ones: those of the base that can move.
inline Vector6 ones_at(const std::vector<int>& rows) {
  Vector6 found = Vector6::Zero();
  for (const int row : rows) {
    if (row < 0 || row > 5) throw std::invalid_argument("rows are numbers from 0 to 5");
    found[row] = 1;
  }
  return found;
}

inline Base base_named(const std::string& name) {
  if (name == "free_flyer") return Base::kFree;
  if (name == "planar") return Base::kPlanar;
  if (name == "attitude_held") return Base::kHeld;
  throw std::invalid_argument("base is " + name + ", not free_flyer, planar or attitude_held");
}

// Returns a result; throws where the core computed what is no number.
inline Array result(const Array& array, const char* name) {
  if (!are_finite(values(array))) throw std::domain_error(std::string(name) + " is not finite");
  return array;
}
inline double result(double value, const char* name) {
  if (!std::isfinite(value)) throw std::domain_error(std::string(name) + " is not finite");
  return value;
}
inline Array result(const std::vector<double>& numbers, const Shape& shape, const char* name) {
  return result(Array(shape, numbers.data()), name);
}
template <typename Derived>
Array result(const Eigen::DenseBase<Derived>& matrix, const char* name) {
  Array array({matrix.rows(), matrix.cols()});
  rows_to_fill(array) = matrix;
  return result(array, name);
}

}  // namespace ff
