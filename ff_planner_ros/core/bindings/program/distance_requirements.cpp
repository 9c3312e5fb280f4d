// Python's way to the distances along paths that the core knows to keep.
#include "program/distance_requirements.hpp"

#include <pybind11/stl.h>

#include <limits>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/distances.hpp"

namespace ff {
namespace {

using Requirement = std::shared_ptr<PathRequirement>;
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

}  // namespace

void bind_distance_requirements(py::module_& m) {
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
}

}  // namespace ff
