// Python's way to the rows of limits on both sides.
#include "optimisation/limit_rows.hpp"

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"

namespace ff {
namespace {

// An array of derivatives with a row a point.
Rows side_by_side(const Array& by_x, const char* name, const Shape& expected) {
  const Rows all = rows(by_x, name, expected);
  return {all.data(), by_x.shape(0), by_x.shape(1) * by_x.shape(2)};
}

LimitRows rows_of(const Array& lower, const Array& upper, const Array& interest, py::ssize_t size) {
  return {values(lower, "lower", {size}), values(upper, "upper", {size}),
          values(interest, "interest", {size})};
}

// Returns what is left, its derivatives and names.
py::tuple answer(const LimitRows& rows, py::ssize_t variables) {
  const auto found = static_cast<py::ssize_t>(rows.values.size());
  return py::make_tuple(result(rows.values, {found}, "rows"),
                        result(rows.jacobian, {found, variables}, "jacobian"),
                        py::array_t<long long>(found, rows.names.data()));
}

py::tuple limit_rows(const Array& of, const Array& by_x, const Array& lower, const Array& upper,
                     const Array& interest) {
  const Rows quantities = rows(of, "values", {kAny, kAny});
  const Rows derivatives = side_by_side(by_x, "by_x", {quantities.rows(), quantities.cols(), kAny});
  LimitRows found = rows_of(lower, upper, interest, quantities.cols());
  found.add_points(quantities, derivatives);
  return answer(found, by_x.shape(2));
}

JointsAtPoints joints(const Array& q, const Array& v, const Array& dq, const Array& dv) {
  const Rows of_q = rows(q, "q", {kAny, kAny});
  const py::ssize_t points = of_q.rows(), joints = of_q.cols() - 7;
  if (points < 1 || joints < 1)
    throw std::invalid_argument("q has the shape " + written({points, of_q.cols()}));
  const Rows of_v = rows(v, "v", {points, 6 + joints});
  const Rows by_q = side_by_side(dq, "q_by_x", {points, 6 + joints, kAny});
  const py::ssize_t size = joints * dq.shape(2);
  const Rows by_v = side_by_side(dv, "v_by_x", {points, 6 + joints, dq.shape(2)});
  return {of_q.rightCols(joints), of_v.rightCols(joints), by_q.rightCols(size),
          by_v.rightCols(size)};
}

// Of joint positions, or rates: at all points but the first, then at extremes in between.
py::tuple rows_along(const JointsAtPoints& of, const Table& values, const Table& by_x,
                     const std::vector<Extreme>& extremes, bool has_duration, LimitRows found) {
  if (has_duration && of.variables() < 1) throw std::invalid_argument("there is no last variable");
  const Eigen::Index later = of.points() - 1;
  found.add_points(values.bottomRows(later), by_x.bottomRows(later));
  found.add_extremes(extremes, of, has_duration);
  return answer(found, of.variables());
}

py::tuple position_rows(const Array& q, const Array& v, const Array& dq, const Array& dv,
                        double step, bool has_duration, const Array& lower, const Array& upper,
                        const Array& interest) {
  const JointsAtPoints of = joints(q, v, dq, dv);
  return rows_along(of, of.positions, of.positions_by_x, turns(of, checked(step, "step")),
                    has_duration, rows_of(lower, upper, interest, of.joints()));
}

py::tuple rate_rows(const Array& q, const Array& v, const Array& dq, const Array& dv, double step,
                    bool has_duration, const Array& lower, const Array& upper,
                    const Array& interest) {
  const JointsAtPoints of = joints(q, v, dq, dv);
  return rows_along(of, of.rates, of.rates_by_x, peak_rates(of, checked(step, "step")),
                    has_duration, rows_of(lower, upper, interest, of.joints()));
}

py::tuple stop_rows(const Array& q, const Array& v, const Array& dq, const Array& dv, double jerk,
                    const Array& lower, const Array& upper, const Array& interest) {
  const JointsAtPoints of = joints(q, v, dq, dv);
  LimitRows found = rows_of(lower, upper, interest, of.joints());
  found.add_stops(of, checked(jerk, "jerk"));
  return answer(found, of.variables());
}

}  // namespace

void bind_limit_rows(py::module_& m) {
  m.def("limit_rows", &limit_rows, py::arg("values"), py::arg("by_x"), py::arg("lower"),
        py::arg("upper"), py::arg("interest"));
  m.def("position_rows", &position_rows, py::arg("q"), py::arg("v"), py::arg("q_by_x"),
        py::arg("v_by_x"), py::arg("step"), py::arg("has_duration"), py::arg("lower"),
        py::arg("upper"), py::arg("interest"));
  m.def("rate_rows", &rate_rows, py::arg("q"), py::arg("v"), py::arg("q_by_x"), py::arg("v_by_x"),
        py::arg("step"), py::arg("has_duration"), py::arg("lower"), py::arg("upper"),
        py::arg("interest"));
  m.def("stop_rows", &stop_rows, py::arg("q"), py::arg("v"), py::arg("q_by_x"), py::arg("v_by_x"),
        py::arg("jerk"), py::arg("lower"), py::arg("upper"), py::arg("interest"));
}

}  // namespace ff
