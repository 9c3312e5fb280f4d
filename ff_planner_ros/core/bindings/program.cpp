// Python's way to a path's program on a time grid.
#include "program/path_program.hpp"

#include <pybind11/typing.h>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "kinematics/deadline.hpp"

namespace ff {
namespace {

using Paths = std::shared_ptr<PathsOnGrid>;
using Requirement = std::shared_ptr<PathRequirement>;

Correction correction(const Array& q, const Array& v, const Array& q_half_way) {
  const Rows of_q = rows(q, "q", {kAny, kAny});
  const py::ssize_t points = of_q.rows(), size = of_q.cols();
  if (points < 2) throw std::invalid_argument("q must have two rows or more");
  const Rows of_q_half_way = rows(q_half_way, "q_half_way", {points - 1, size});
  RowMajor steps(2 * points - 1, size);
  steps << of_q, of_q_half_way;
  return {steps, rows(v, "v", {points, size})};
}

PathObjective path_objective(double joint_path, double slow, double smoothing, const Array& shares,
                             double attitude, const Array& chaser_to_base, double attitude_norm,
                             double wheel_momentum, const std::optional<Wheels>& wheels) {
  return {checked(joint_path, "joint_path"),
          checked(slow, "slow"),
          checked(smoothing, "smoothing"),
          values(shares, "shares", {kAny}),
          checked(attitude, "attitude"),
          matrix3(chaser_to_base, "rotation_chaser_to_base"),
          checked(attitude_norm, "attitude_norm"),
          checked(wheel_momentum, "wheel_momentum"),
          wheels};
}

// A motion at which Python is asked for rows.
struct MotionOfPath {
  const PathMotion& motion;
  const PathDerivatives& derivatives;

  // Shape (points, velocities, variables); from a point on, or from half-way after the first.
  Array by_x(const RowMajor& of_q_or_v, Eigen::Index first, Eigen::Index count) const {
    const Eigen::Index size = motion.v.cols();
    return Array(Shape{count, size, motion.variables()}, of_q_or_v.row(first * size).data());
  }
};

// Copies of what whoever has a motion shows of it: they outlive what was evaluated.
template <typename Class>
Class& bind_motion_in(Class& to) {
  using Of = typename Class::type;
  const auto matrix = [](auto member) {
    return [member](const Of& of) {
      const RowMajor& rows = of.motion.*member;
      return Array(Shape{rows.rows(), rows.cols()}, rows.data());
    };
  };
  const auto vector = [](auto member) {
    return [member](const Of& of) {
      const Eigen::VectorXd& numbers = of.motion.*member;
      return Array(numbers.size(), numbers.data());
    };
  };
  const auto configurations = [](bool half_way) {
    return [half_way](const Of& of) {
      const PathMotion& motion = of.motion;
      const Eigen::Index first = half_way ? motion.points() : 0;
      return Array(Shape{motion.points() - half_way, motion.q.cols()}, motion.q.row(first).data());
    };
  };
  return to.def_property_readonly("x", vector(&PathMotion::x))
      .def_property_readonly("q", configurations(false))
      .def_property_readonly("v", matrix(&PathMotion::v))
      .def_property_readonly("q_half_way", configurations(true))
      .def_property_readonly("acceleration", matrix(&PathMotion::acceleration))
      .def_property_readonly("goal_error", vector(&PathMotion::goal_error))
      .def_property_readonly("goal_error_by_x", matrix(&PathMotion::goal_error_by_x));
}

// What the core does not know.
struct RowsByPython : PathRequirement {
  py::function rows_of;

  explicit RowsByPython(py::function rows_of) : rows_of(std::move(rows_of)) {}

  ConstraintRows rows(const LookedAt& at) const override {
    if (!at.elsewhere.has_value()) at.elsewhere = py::cast(MotionOfPath{at.motion, at.by_x});
    const py::object found = rows_of(std::any_cast<py::object>(at.elsewhere));
    if (found.is_none()) return {};
    const auto [left, by_x, names] = found.cast<std::tuple<Array, Array, Numbers>>();
    const Values of = values(left, "rows", {kAny});
    const Rows derivatives = rows_of_array(by_x, of.size(), at.motion.variables());
    require_shape(names, "names", {of.size()});
    return {{of.begin(), of.end()},
            {derivatives.data(), derivatives.data() + derivatives.size()},
            {names.data(), names.data() + names.size()}};
  }

 private:
  static Rows rows_of_array(const Array& by_x, py::ssize_t count, py::ssize_t variables) {
    return ff::rows(by_x, "jacobian", {count, variables});
  }
};

using KnownOrNot = std::variant<Requirement, py::typing::Callable<py::object(MotionOfPath)>>;

PathProgram path_program(const Paths& paths, double step, const PathObjective& objective,
                         const std::vector<std::pair<long long, KnownOrNot>>& requirements,
                         const std::optional<Correction>& correction) {
  const py::ssize_t joints = paths->chain().joints();
  if (objective.shares.size() > 0 && objective.shares.size() != 6 + joints)
    throw std::invalid_argument("shares are of another chain");
  std::vector<PathProgram::Numbered> numbered;
  for (const auto& [number, one] : requirements) {
    const auto* known = std::get_if<Requirement>(&one);
    numbered.push_back({number, known ? *known : std::make_shared<RowsByPython>(std::get<1>(one))});
    numbered.back().requirement->require_fits(*paths->chain().tree, paths->points());
  }
  if (correction && (correction->v.rows() != paths->points() || correction->v.cols() != 6 + joints))
    throw std::invalid_argument("correction is of other points, or of another chain");
  if (!(checked(step, "step") > 0)) throw std::invalid_argument("step must be positive");
  return {paths, step, objective, numbered, correction};
}

// A block of Python in which the core ends what it computes after some time.
class DeadlineOfBlock {
 public:
  explicit DeadlineOfBlock(double seconds) : seconds_(checked(seconds, "seconds")) {}

  void enter() { deadline_.emplace(end()); }
  void leave(const py::object&, const py::object&, const py::object&) { deadline_.reset(); }

 private:
  static constexpr double kEver = 1e9;  // [s]

  Deadline::Time end() const {
    if (seconds_ >= kEver) return Deadline::Time::max();
    const std::chrono::duration<double> left(std::max(seconds_, 0.0));
    return std::chrono::steady_clock::now() +
           std::chrono::duration_cast<std::chrono::steady_clock::duration>(left);
  }

  double seconds_;
  std::optional<Deadline> deadline_;
};

using Evaluated = std::shared_ptr<EvaluatedPath>;

// Throws where the core computed what is no number.
Evaluated evaluated(PathProgram& program, const Array& x) {
  auto found = std::make_shared<EvaluatedPath>(program.at(values(x, "x", {program.variables()})));
  if (!found->is_defined()) return found;
  const auto require = [](const auto& of, const char* name) {
    if (!are_finite({of.data(), static_cast<Eigen::Index>(of.size())}))
      throw std::domain_error(std::string(name) + " is not finite");
  };
  const PathMotion& motion = found->motion;
  require(motion.q, "q");
  require(motion.v, "v");
  require(motion.acceleration, "acceleration");
  require(motion.goal_error, "goal error");
  require(motion.goal_error_by_x, "d(goal error)/dx");
  result(found->terms.value, "value");
  require(found->terms.gradient, "gradient");
  require(found->terms.hessian, "hessian");
  require(found->terms.max_terms, "max terms");
  require(found->terms.max_terms_jacobian, "d(max terms)/dx");
  require(found->rows.values, "constraints");
  require(found->rows.jacobian, "d(constraints)/dx");
  return found;
}

// An array of numbers that `owner` keeps, which nobody may change.
template <typename T>
py::array_t<T> kept(const py::object& owner, const T* numbers, const Shape& shape) {
  py::array_t<T> found(shape, numbers, owner);
  py::detail::array_proxy(found.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  return found;
}

// What Python sees of a vector or a matrix of an evaluated path.
template <typename Of>
auto vector(Of of) {
  return [of](const py::object& self) {
    const auto& numbers = of(self.cast<const EvaluatedPath&>());
    return kept(self, numbers.data(), {static_cast<py::ssize_t>(numbers.size())});
  };
}
template <typename Of>
auto matrix(Of of) {
  return [of](const py::object& self) {
    const RowMajor& numbers = of(self.cast<const EvaluatedPath&>());
    return kept(self, numbers.data(), {numbers.rows(), numbers.cols()});
  };
}

void bind_evaluated(py::module_& m) {
  const auto terms = [](auto member) {
    return matrix([member](const EvaluatedPath& of) -> auto& { return of.terms.*member; });
  };
  py::class_<EvaluatedPath, Evaluated> evaluated(m, "EvaluatedPath");
  bind_motion_in(evaluated)
      .def_property_readonly("is_defined", &EvaluatedPath::is_defined)
      .def_property_readonly("singular_at",
                             [](const EvaluatedPath& of) -> std::optional<double> {
                               if (of.is_defined()) return std::nullopt;
                               return of.motion.singular_at;
                             })
      .def_property_readonly("objective",
                             [](const EvaluatedPath& of) { return of.functions().objective(); })
      .def_property_readonly("violation",
                             [](const EvaluatedPath& of) { return of.functions().violation(); })
      .def_property_readonly("value", [](const EvaluatedPath& of) { return of.terms.value; })
      .def_property_readonly(
          "gradient", vector([](const EvaluatedPath& of) -> auto& { return of.terms.gradient; }))
      .def_property_readonly(
          "max_terms", vector([](const EvaluatedPath& of) -> auto& { return of.terms.max_terms; }))
      .def_property_readonly(
          "constraints", vector([](const EvaluatedPath& of) -> auto& { return of.rows.values; }))
      .def_property_readonly("names",
                             vector([](const EvaluatedPath& of) -> auto& { return of.rows.names; }))
      .def_property_readonly("constraints_jacobian",
                             [](const py::object& self) {
                               const auto& of = self.cast<const EvaluatedPath&>();
                               const auto count = static_cast<py::ssize_t>(of.rows.values.size());
                               return kept(self, of.rows.jacobian.data(),
                                           {count, of.motion.variables()});
                             })
      .def_property_readonly("hessian", terms(&Terms::hessian))
      .def_property_readonly("max_terms_jacobian", terms(&Terms::max_terms_jacobian));
}

void bind_motion_of_path(py::module_& m) {
  py::class_<MotionOfPath> motion(m, "MotionOfPath");
  bind_motion_in(motion)
      .def_property_readonly(
          "q_by_x",
          [](const MotionOfPath& of) { return of.by_x(of.derivatives.q, 0, of.motion.points()); })
      .def_property_readonly(
          "v_by_x",
          [](const MotionOfPath& of) { return of.by_x(of.derivatives.v, 0, of.motion.points()); })
      .def_property_readonly("q_half_way_by_x", [](const MotionOfPath& of) {
        return of.by_x(of.derivatives.q, of.motion.points(), of.motion.points() - 1);
      });
}

}  // namespace

void bind_program(py::module_& m) {
  bind_evaluated(m);
  bind_motion_of_path(m);
  py::class_<Correction>(m, "Correction")
      .def(py::init(&correction), py::arg("q"), py::arg("v"), py::arg("q_half_way"));
  py::class_<PathObjective>(m, "PathObjective")
      .def(py::init(&path_objective), py::arg("joint_path"), py::arg("slow"), py::arg("smoothing"),
           py::arg("shares"), py::arg("attitude"), py::arg("rotation_chaser_to_base"),
           py::arg("attitude_norm"), py::arg("wheel_momentum") = 0.0,
           py::arg("wheels") = std::nullopt);
  py::register_exception<DeadlineOver>(m, "DeadlineOver");
  py::class_<DeadlineOfBlock>(m, "Deadline")
      .def(py::init<double>(), py::arg("seconds"))
      .def("__enter__", &DeadlineOfBlock::enter)
      .def("__exit__", &DeadlineOfBlock::leave);
  m.attr("NAMES_EACH") = PathProgram::kNames;
  py::class_<PathProgram>(m, "PathProgram")
      .def(py::init(&path_program), py::arg("paths"), py::arg("step"), py::arg("objective"),
           py::arg("requirements"), py::arg("correction") = std::nullopt)
      .def("at", &evaluated, py::arg("x"));
}

}  // namespace ff
