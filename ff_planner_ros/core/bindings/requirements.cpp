// Python's way to what the core requires of paths.

#include <limits>
#include <optional>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/obstacles.hpp"
#include "program/distance_requirements.hpp"
#include "program/goal_requirements.hpp"
#include "program/load_requirements.hpp"
#include "program/path_requirements.hpp"

namespace ff {
namespace {

using Requirement = std::shared_ptr<PathRequirement>;

Requirement positions_within(const Array& lower, const Array& upper, double excess, double margin,
                             double interest, double stop_interest, double jerk, double step) {
  const auto made = std::make_shared<PositionsWithin>();
  made->lower = values(lower, "lower", {kAny});
  made->upper = values(upper, "upper", {made->lower.size()});
  made->excess = checked(excess, "excess");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  made->stop_interest = checked(stop_interest, "stop_interest");
  made->jerk = checked(jerk, "jerk");
  made->step = checked(step, "step");
  return made;
}

Requirement rates_within(const Array& limits, double excess, double margin, double interest,
                         double step) {
  const auto made = std::make_shared<RatesWithin>();
  made->limits = values(limits, "limits", {kAny});
  made->excess = checked(excess, "excess");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  made->step = checked(step, "step");
  return made;
}

Requirement attitude_within(const Array& chaser_to_base, double limit, double interest) {
  const auto made = std::make_shared<AttitudeWithin>();
  made->chaser_to_base = matrix3(chaser_to_base, "rotation_chaser_to_base");
  made->limit = checked(limit, "limit");
  made->interest = checked(interest, "interest");
  return made;
}

Requirement rotation_within(double limit, double knee, double interest) {
  const auto made = std::make_shared<RotationWithin>();
  made->limit = checked(limit, "limit");
  made->knee = checked(knee, "knee");
  made->interest = checked(interest, "interest");
  return made;
}

Requirement singular_value_above(const std::vector<int>& movable, double margin, double interest) {
  const auto made = std::make_shared<SingularValueAbove>();
  made->movable = ones_at(movable);
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  return made;
}

template <typename Loads>
std::shared_ptr<Loads> loads_within(double margin, double interest, double step) {
  const auto made = std::make_shared<Loads>();
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  made->step = checked(step, "step");
  if (!(step > 0)) throw std::invalid_argument("step must be positive");
  return made;
}

Requirement accelerations_within(const Array& parts, double margin, double interest, double step,
                                 bool between) {
  const auto made = loads_within<AccelerationsWithin>(margin, interest, step);
  made->parts = values(parts, "parts", {kAny});
  made->between = between;
  return made;
}

Requirement torques_within(const std::string& base, const Array& parts, double margin,
                           double interest, double step) {
  const auto made = loads_within<TorquesWithin>(margin, interest, step);
  made->base = base_named(base);
  made->parts = values(parts, "parts", {kAny});
  return made;
}

Requirement grasp_wrench_within(const std::string& base, int joints_before, const Array& position,
                                const Array& rotation, double mass, const Array& center,
                                const Array& inertia, const Array& parts, double margin,
                                double interest, double step) {
  const auto made = loads_within<GraspWrenchWithin>(margin, interest, step);
  made->base = base_named(base);
  if (joints_before < 0) throw std::invalid_argument("joints_before must not be negative");
  made->joints_before = joints_before;
  made->frame = {vector3(position, "position"), matrix3(rotation, "rotation")};
  made->mass = checked(mass, "mass");
  made->center = vector3(center, "center");
  made->inertia = matrix3(inertia, "inertia");
  const Values of_kinds = values(parts, "parts", {2});
  made->parts[0] = of_kinds[0];
  made->parts[1] = of_kinds[1];
  return made;
}

Wheels wheels(const Array& shares, const Array& stored) {
  const Rows of_wheels = rows(shares, "shares", {kAny, 3});
  return {of_wheels, values(stored, "stored", {of_wheels.rows()})};
}

Requirement wheels_within(const Wheels& wheels, const Array& momenta, const Array& torques,
                          double excess, double margin, double interest, double step,
                          bool between) {
  const auto made = loads_within<WheelsWithin>(margin, interest, step);
  made->wheels = wheels;
  made->momenta = values(momenta, "momenta", {wheels.count()});
  made->torques = values(torques, "torques", {wheels.count()});
  made->excess = checked(excess, "excess");
  made->between = between;
  return made;
}

using Contacts = std::optional<std::shared_ptr<AllowedContacts>>;

Margins margins(double margin, const Array& room, double little, double gained) {
  return {checked(margin, "margin"), values(room, "room", {kAny}), checked(little, "little"),
          checked(gained, "gained")};
}

// How many there are is known where they are used.
std::vector<int> pairs_of(const Numbers& pairs) {
  require_shape(pairs, "pairs", {kAny});
  for (py::ssize_t i = 0; i < pairs.size(); ++i)
    if (pairs.at(i) < 0 || pairs.at(i) > std::numeric_limits<int>::max())
      throw std::invalid_argument("pairs has " + std::to_string(pairs.at(i)) + ", which is none");
  return {pairs.data(), pairs.data() + pairs.size()};
}

void require_among(const std::vector<int>& pairs, size_t count) {
  for (const int pair : pairs)
    if (static_cast<size_t>(pair) >= count)
      throw std::invalid_argument("pairs has " + std::to_string(pair) + ", and there are " +
                                  std::to_string(count));
}

AllowedContacts::AtStart contacts_at_start(const Numbers& pairs, const Array& places,
                                           bool seen_from_base) {
  return {pairs_of(pairs), rows(places, "places", {kAny, 3}), seen_from_base};
}

AllowedContacts allowed_contacts(const Numbers& pairs, const Array& goal, double distance,
                                 const std::vector<AllowedContacts::AtStart>& at_start) {
  return {pairs_of(pairs), rows(goal, "goal", {kAny, 3}), checked(distance, "distance"), at_start};
}

template <typename Kept>
std::shared_ptr<Kept> distances_kept(const Margins& margins, const Array& times, double interest,
                                     bool quarter_way) {
  const auto made = std::make_shared<Kept>();
  made->margins = margins;
  made->times = values(times, "times", {kAny});
  made->interest = checked(interest, "interest");
  made->quarter_way = quarter_way;
  return made;
}

BodiesWithContacts with_contacts(const std::shared_ptr<Bodies>& bodies, const Contacts& allowed,
                                 size_t pairs) {
  if (!allowed) return {bodies, nullptr};
  require_among((*allowed)->pairs, pairs);
  for (const AllowedContacts::AtStart& of : (*allowed)->at_start) require_among(of.pairs, pairs);
  return {bodies, *allowed};
}

template <typename Held>
auto all_of(const std::shared_ptr<Held>& held) {
  return std::shared_ptr<const std::remove_reference_t<decltype(held->all)>>(held, &held->all);
}

Requirement lines_clear(const std::shared_ptr<Spheres>& spheres, const Margins& margins,
                        const Array& times, double interest, bool quarter_way) {
  const auto made = distances_kept<LinesClearOfSpheres>(margins, times, interest, quarter_way);
  made->spheres = all_of(spheres);
  return made;
}

template <typename Kept>
std::shared_ptr<Kept> bodies_clear(const std::shared_ptr<Bodies>& bodies, size_t obstacles,
                                   const Margins& margins, const Array& times, double interest,
                                   bool quarter_way, const Contacts& allowed) {
  const size_t pairs = bodies->bodies.size() * obstacles;
  if (static_cast<size_t>(margins.room.size()) != pairs)
    throw std::invalid_argument("room has " + std::to_string(margins.room.size()) +
                                " numbers, and there are " + std::to_string(pairs) + " pairs");
  const auto made = distances_kept<Kept>(margins, times, interest, quarter_way);
  made->bodies = with_contacts(bodies, allowed, pairs);
  return made;
}

Requirement clear_of_spheres(const std::shared_ptr<Bodies>& bodies,
                             const std::shared_ptr<Spheres>& spheres, const Margins& margins,
                             const Array& times, double interest, bool quarter_way,
                             const Contacts& allowed) {
  const auto made = bodies_clear<BodiesClearOfSpheres>(bodies, spheres->all.size(), margins, times,
                                                       interest, quarter_way, allowed);
  made->spheres = all_of(spheres);
  return made;
}

Requirement clear_of_obstacles(const std::shared_ptr<Bodies>& bodies,
                               const std::shared_ptr<Obstacles>& obstacles, const Margins& margins,
                               const Array& times, double interest, bool quarter_way,
                               const Contacts& allowed) {
  const auto made = bodies_clear<BodiesClearOfObstacles>(bodies, obstacles->all.size(), margins,
                                                         times, interest, quarter_way, allowed);
  made->obstacles = all_of(obstacles);
  return made;
}

Requirement pairs_apart(const std::shared_ptr<Bodies>& bodies, const Array& margins,
                        double interest, bool quarter_way, const Contacts& allowed) {
  const auto made = std::make_shared<PairsApart>();
  made->bodies = with_contacts(bodies, allowed, bodies->pairs.size());
  made->margins = values(margins, "margins", {static_cast<py::ssize_t>(bodies->pairs.size())});
  made->interest = checked(interest, "interest");
  made->quarter_way = quarter_way;
  return made;
}

GraspSeen grasp_seen(const Array& positions, const Array& rotations, const Array& counts,
                     const Array& twists, bool moves_with_goal) {
  const Rows places = rows(positions, "positions", {kAny, 3});
  const py::ssize_t times = places.rows();
  return {places, rows(rotations, "rotations", {times, 3, 3}), vector3(counts, "counts"),
          rows(twists, "twists", {times, 6}), moves_with_goal};
}

Requirement in_corridor(const GraspSeen& grasp, const Array& direction, double distance,
                        double half_angle, double radius, double back_off, double margin,
                        double interest) {
  const auto made = std::make_shared<InCorridor>();
  made->grasp = grasp;
  made->direction = vector3(direction, "direction");
  made->distance = checked(distance, "distance");
  made->half_angle = checked(half_angle, "half_angle");
  made->radius = checked(radius, "radius");
  made->back_off = checked(back_off, "back_off");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  return made;
}

Requirement goal_in_view(const GraspSeen& grasp, int carrier, const Array& rotation,
                         const Array& position, const Array& axis, double half_angle, double until,
                         double margin, double interest) {
  const auto made = std::make_shared<GoalInView>();
  made->grasp = grasp;
  if (carrier < 0) throw std::invalid_argument("carrier must be zero or more");
  made->carrier = carrier;
  made->mount = {vector3(position, "position"), matrix3(rotation, "rotation")};
  made->axis = vector3(axis, "axis");
  made->half_angle = checked(half_angle, "half_angle");
  made->until = checked(until, "until");
  made->margin = checked(margin, "margin");
  made->interest = checked(interest, "interest");
  return made;
}

}  // namespace

void bind_requirements(py::module_& m) {
  py::class_<PathRequirement, Requirement>(m, "PathRequirement");
  m.def("positions_within", &positions_within, py::arg("lower"), py::arg("upper"),
        py::arg("excess"), py::arg("margin"), py::arg("interest"), py::arg("stop_interest"),
        py::arg("jerk"), py::arg("step"));
  m.def("rates_within", &rates_within, py::arg("limits"), py::arg("excess"), py::arg("margin"),
        py::arg("interest"), py::arg("step"));
  m.def("attitude_within", &attitude_within, py::arg("rotation_chaser_to_base"), py::arg("limit"),
        py::arg("interest"));
  m.def("rotation_within", &rotation_within, py::arg("limit"), py::arg("knee"),
        py::arg("interest"));
  m.def("singular_value_above", &singular_value_above, py::arg("rows"), py::arg("margin"),
        py::arg("interest"));
  m.def("accelerations_within", &accelerations_within, py::arg("parts"), py::arg("margin"),
        py::arg("interest"), py::arg("step"), py::arg("between"));
  m.def("torques_within", &torques_within, py::arg("base"), py::arg("parts"), py::arg("margin"),
        py::arg("interest"), py::arg("step"));
  m.def("grasp_wrench_within", &grasp_wrench_within, py::arg("base"), py::arg("joints_before"),
        py::arg("position"), py::arg("rotation"), py::arg("mass"), py::arg("center"),
        py::arg("inertia"), py::arg("parts"), py::arg("margin"), py::arg("interest"),
        py::arg("step"));
  py::class_<Wheels>(m, "Wheels").def(py::init(&wheels), py::arg("shares"), py::arg("stored"));
  m.def("wheels_within", &wheels_within, py::arg("wheels"), py::arg("momenta"), py::arg("torques"),
        py::arg("excess"), py::arg("margin"), py::arg("interest"), py::arg("step"),
        py::arg("between"));
  py::class_<Margins>(m, "Margins")
      .def(py::init(&margins), py::arg("margin"), py::arg("room"), py::arg("little"),
           py::arg("gained"));
  py::class_<AllowedContacts::AtStart>(m, "ContactsAtStart")
      .def(py::init(&contacts_at_start), py::arg("pairs"), py::arg("places"),
           py::arg("seen_from_base"));
  py::class_<AllowedContacts, Contacts::value_type>(m, "AllowedContacts")
      .def(py::init(&allowed_contacts), py::arg("pairs"), py::arg("goal"), py::arg("distance"),
           py::arg("at_start"));
  m.def("lines_clear_of_spheres", &lines_clear, py::arg("spheres"), py::arg("margins"),
        py::arg("times"), py::arg("interest"), py::arg("quarter_way"));
  m.def("bodies_clear_of_spheres", &clear_of_spheres, py::arg("bodies"), py::arg("spheres"),
        py::arg("margins"), py::arg("times"), py::arg("interest"), py::arg("quarter_way"),
        py::arg("allowed"));
  m.def("bodies_clear_of_obstacles", &clear_of_obstacles, py::arg("bodies"), py::arg("obstacles"),
        py::arg("margins"), py::arg("times"), py::arg("interest"), py::arg("quarter_way"),
        py::arg("allowed"));
  m.def("pairs_apart", &pairs_apart, py::arg("bodies"), py::arg("margins"), py::arg("interest"),
        py::arg("quarter_way"), py::arg("allowed"));
  py::class_<GraspSeen>(m, "GraspSeen")
      .def(py::init(&grasp_seen), py::arg("positions"), py::arg("rotations"), py::arg("counts"),
           py::arg("twists"), py::arg("moves_with_goal"));
  m.def("in_corridor", &in_corridor, py::arg("grasp"), py::arg("direction"), py::arg("distance"),
        py::arg("half_angle"), py::arg("radius"), py::arg("back_off"), py::arg("margin"),
        py::arg("interest"));
  m.def("goal_in_view", &goal_in_view, py::arg("grasp"), py::arg("carrier"), py::arg("rotation"),
        py::arg("position"), py::arg("axis"), py::arg("half_angle"), py::arg("until"),
        py::arg("margin"), py::arg("interest"));
}

}  // namespace ff
