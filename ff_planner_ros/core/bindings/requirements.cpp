// Python's way to what the core requires of paths.

#include <limits>
#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "program/chaser_at_goal.hpp"
#include "program/distance_requirements.hpp"
#include "program/follows_path.hpp"
#include "program/goal_requirements.hpp"
#include "program/load_requirements.hpp"
#include "program/path_requirements.hpp"

namespace ff {
namespace {

using Requirement = std::shared_ptr<PathRequirement>;

// How Python gives a field of a requirement.
template <typename T>
struct Given {
  using Type = T;
};
template <int N>
struct Given<Eigen::Matrix<double, N, 1>> {
  using Type = Array;
};
template <>
struct Given<Matrix3> {
  using Type = Array;
};
template <>
struct Given<RowMajor> {
  using Type = Array;
};
template <>
struct Given<Vector6> {  // ones and zeros: the numbers of those that count
  using Type = std::vector<int>;
};
template <>
struct Given<Base> {
  using Type = std::string;
};
// These throw ValueError of Python where it is not as expected.
void take(double& to, double given, const char* name) { to = checked(given, name); }
void take(int& to, int given, const char* name) {
  if (given < 0) throw std::invalid_argument(std::string(name) + " must not be negative");
  to = given;
}
void take(Eigen::VectorXd& to, const Array& given, const char* name) {
  to = values(given, name, {kAny});
}
void take(RowMajor& to, const Array& given, const char* name) { to = rows(given, name, {kAny, 3}); }
void take(Vector3& to, const Array& given, const char* name) { to = vector3(given, name); }
void take(Matrix3& to, const Array& given, const char* name) { to = matrix3(given, name); }
void take(Vector6& to, const std::vector<int>& given, const char*) { to = ones_at(given); }
void take(Base& to, const std::string& given, const char*) { to = base_named(given); }
template <typename T>
void take(T& to, const T& given, const char*) {  // a flag, or checked when it was made
  to = given;
}

template <typename Owner, typename T>
struct Field {
  const char* name;
  T Owner::* member;
};
template <typename Owner, typename T>
Field(const char*, T Owner::*) -> Field<Owner, T>;

// Binds what makes a requirement of its fields.
template <typename Made, typename... Owners, typename... Ts>
void required(py::module_& m, const char* name, const Field<Owners, Ts>&... fields) {
  m.def(
      name,
      [fields...](const typename Given<Ts>::Type&... given) -> Requirement {
        const auto made = std::make_shared<Made>();
        (take((*made).*fields.member, given, fields.name), ...);
        return made;
      },
      py::arg(fields.name)...);
}

Wheels wheels(const Array& shares, const Array& stored) {
  const Rows of_wheels = rows(shares, "shares", {kAny, 3});
  return {of_wheels, values(stored, "stored", {of_wheels.rows()})};
}

using Contacts = std::optional<std::shared_ptr<AllowedContacts>>;

// How many there are is known where they are used.
std::vector<int> pairs_of(const Numbers& pairs) {
  require_shape(pairs, "pairs", {kAny});
  for (py::ssize_t i = 0; i < pairs.size(); ++i)
    if (pairs.at(i) < 0 || pairs.at(i) > std::numeric_limits<int>::max())
      throw std::invalid_argument("pairs has " + std::to_string(pairs.at(i)) + ", which is none");
  return {pairs.data(), pairs.data() + pairs.size()};
}

AllowedContacts::AtStart contacts_at_start(const Numbers& pairs, const Array& places,
                                           bool seen_from_base) {
  return {pairs_of(pairs), rows(places, "places", {kAny, 3}), seen_from_base};
}

AllowedContacts allowed_contacts(const Numbers& pairs, const Array& goal, double distance,
                                 const std::vector<AllowedContacts::AtStart>& at_start) {
  return {pairs_of(pairs), rows(goal, "goal", {kAny, 3}), checked(distance, "distance"), at_start};
}

// Sets what distances of so many pairs have in common.
Requirement apart(const std::shared_ptr<BodiesApart>& made, const std::shared_ptr<Bodies>& bodies,
                  size_t pairs, double interest, bool quarter_way, const Contacts& allowed) {
  made->bodies = bodies;
  made->interest = checked(interest, "interest");
  made->quarter_way = quarter_way;
  if (!allowed) return made;
  const auto require_among = [&](const std::vector<int>& numbers) {
    for (const int pair : numbers)
      if (static_cast<size_t>(pair) >= pairs)
        throw std::invalid_argument("pairs has " + std::to_string(pair) + ", and there are " +
                                    std::to_string(pairs));
  };
  require_among((*allowed)->pairs);
  for (const AllowedContacts::AtStart& of : (*allowed)->at_start) require_among(of.pairs);
  made->allowed = *allowed;
  return made;
}

Requirement bodies_clear(const std::shared_ptr<Bodies>& bodies,
                         const std::shared_ptr<Obstacles>& obstacles, double margin,
                         const Array& room, const Array& times, double interest, bool quarter_way,
                         const Contacts& allowed) {
  const size_t pairs = bodies->bodies.size() * obstacles->size();
  const auto made = std::make_shared<BodiesClear>();
  made->obstacles = obstacles;
  made->margins = {checked(margin, "margin"),
                   values(room, "room", {static_cast<py::ssize_t>(pairs)})};
  made->times = values(times, "times", {kAny});
  return apart(made, bodies, pairs, interest, quarter_way, allowed);
}

Requirement pairs_apart(const std::shared_ptr<Bodies>& bodies, const Array& margins,
                        double interest, bool quarter_way, const Contacts& allowed) {
  const size_t pairs = bodies->pairs.size();
  const auto made = std::make_shared<PairsApart>();
  made->margins = values(margins, "margins", {static_cast<py::ssize_t>(pairs)});
  return apart(made, bodies, pairs, interest, quarter_way, allowed);
}

GraspSeen grasp_seen(const Array& positions, const Array& rotations, const Array& counts,
                     const Array& twists, bool moves_with_goal) {
  const Rows places = rows(positions, "positions", {kAny, 3});
  const py::ssize_t times = places.rows();
  return {places, rows(rotations, "rotations", {times, 3, 3}), vector3(counts, "counts"),
          rows(twists, "twists", {times, 6}), moves_with_goal};
}

}  // namespace

void bind_requirements(py::module_& m) {
  py::class_<PathRequirement, Requirement>(m, "PathRequirement");
  required<PositionsWithin>(
      m, "positions_within", Field{"lower", &PositionsWithin::lower},
      Field{"upper", &PositionsWithin::upper}, Field{"excess", &PositionsWithin::excess},
      Field{"margin", &PositionsWithin::margin}, Field{"interest", &PositionsWithin::interest},
      Field{"stop_interest", &PositionsWithin::stop_interest},
      Field{"jerk", &PositionsWithin::jerk});
  required<RatesWithin>(m, "rates_within", Field{"limits", &RatesWithin::limits},
                        Field{"excess", &RatesWithin::excess},
                        Field{"margin", &RatesWithin::margin},
                        Field{"interest", &RatesWithin::interest});
  required<AttitudeWithin>(
      m, "attitude_within", Field{"rotation_chaser_to_base", &AttitudeWithin::chaser_to_base},
      Field{"limit", &AttitudeWithin::limit}, Field{"interest", &AttitudeWithin::interest});
  required<RotationWithin>(m, "rotation_within", Field{"limit", &RotationWithin::limit},
                           Field{"knee", &RotationWithin::knee},
                           Field{"interest", &RotationWithin::interest});
  required<ChaserAtGoal>(m, "chaser_at_goal", Field{"rotation", &ChaserAtGoal::wanted},
                         Field{"limit", &ChaserAtGoal::limit}, Field{"knee", &ChaserAtGoal::knee});
  required<SingularValueAbove>(m, "singular_value_above",
                               Field{"rows", &SingularValueAbove::movable},
                               Field{"margin", &SingularValueAbove::margin},
                               Field{"interest", &SingularValueAbove::interest});
  required<AccelerationsWithin>(
      m, "accelerations_within", Field{"parts", &AccelerationsWithin::parts},
      Field{"margin", &LoadsWithin::margin}, Field{"interest", &LoadsWithin::interest},
      Field{"between", &AccelerationsWithin::between});
  required<TorquesWithin>(m, "torques_within", Field{"base", &DynamicLoadsWithin::base},
                          Field{"parts", &TorquesWithin::parts},
                          Field{"margin", &LoadsWithin::margin},
                          Field{"interest", &LoadsWithin::interest});
  required<GraspWrenchWithin>(
      m, "grasp_wrench_within", Field{"base", &DynamicLoadsWithin::base},
      Field{"link", &GraspWrenchWithin::link}, Field{"position", &GraspWrenchWithin::position},
      Field{"rotation", &GraspWrenchWithin::rotation}, Field{"mass", &GraspWrenchWithin::mass},
      Field{"center", &GraspWrenchWithin::center}, Field{"inertia", &GraspWrenchWithin::inertia},
      Field{"parts", &GraspWrenchWithin::parts}, Field{"margin", &LoadsWithin::margin},
      Field{"interest", &LoadsWithin::interest});
  py::class_<Wheels>(m, "Wheels").def(py::init(&wheels), py::arg("shares"), py::arg("stored"));
  required<WheelsWithin>(
      m, "wheels_within", Field{"wheels", &WheelsWithin::wheels},
      Field{"momenta", &WheelsWithin::momenta}, Field{"torques", &WheelsWithin::torques},
      Field{"excess", &WheelsWithin::excess}, Field{"margin", &LoadsWithin::margin},
      Field{"interest", &LoadsWithin::interest}, Field{"between", &WheelsWithin::between});
  py::class_<AllowedContacts::AtStart>(m, "ContactsAtStart")
      .def(py::init(&contacts_at_start), py::arg("pairs"), py::arg("places"),
           py::arg("seen_from_base"));
  py::class_<AllowedContacts, Contacts::value_type>(m, "AllowedContacts")
      .def(py::init(&allowed_contacts), py::arg("pairs"), py::arg("goal"), py::arg("distance"),
           py::arg("at_start"));
  m.def("bodies_clear", &bodies_clear, py::arg("bodies"), py::arg("obstacles"), py::arg("margin"),
        py::arg("room"), py::arg("times"), py::arg("interest"), py::arg("quarter_way"),
        py::arg("allowed"));
  m.def("pairs_apart", &pairs_apart, py::arg("bodies"), py::arg("margins"), py::arg("interest"),
        py::arg("quarter_way"), py::arg("allowed"));
  py::class_<GraspSeen>(m, "GraspSeen")
      .def(py::init(&grasp_seen), py::arg("positions"), py::arg("rotations"), py::arg("counts"),
           py::arg("twists"), py::arg("moves_with_goal"));
  required<InCorridor>(
      m, "in_corridor", Field{"grasp", &InCorridor::grasp},
      Field{"direction", &InCorridor::direction}, Field{"distance", &InCorridor::distance},
      Field{"half_angle", &InCorridor::half_angle}, Field{"radius", &InCorridor::radius},
      Field{"back_off", &InCorridor::back_off}, Field{"margin", &InCorridor::margin},
      Field{"interest", &InCorridor::interest});
  required<GoalInView>(
      m, "goal_in_view", Field{"grasp", &GoalInView::grasp}, Field{"carrier", &GoalInView::carrier},
      Field{"rotation", &GoalInView::rotation}, Field{"position", &GoalInView::position},
      Field{"axis", &GoalInView::axis}, Field{"half_angle", &GoalInView::half_angle},
      Field{"until", &GoalInView::until}, Field{"margin", &GoalInView::margin},
      Field{"interest", &GoalInView::interest});
  required<FollowsPath>(
      m, "follows_path", Field{"positions", &FollowsPath::positions},
      Field{"rotations", &FollowsPath::rotations}, Field{"counts", &FollowsPath::counts},
      Field{"position", &FollowsPath::position}, Field{"orientation", &FollowsPath::orientation});
}

}  // namespace ff
