#include "collision/threads.hpp"

namespace ff {

size_t usable_cores() {
#ifdef __linux__
  cpu_set_t cores;
  if (sched_getaffinity(0, sizeof cores, &cores) == 0) return CPU_COUNT(&cores);
#endif
  return 1;
}

DistanceRows joined(const std::vector<DistanceRows>& parts, long long count) {
  DistanceRows all;
  std::vector<std::pair<const DistanceRows*, size_t>> rows;  // a part, and a number in it
  for (const DistanceRows& part : parts)
    for (size_t number = 0; number < part.names.size(); ++number) rows.emplace_back(&part, number);
  std::stable_sort(rows.begin(), rows.end(), [&](const auto& a, const auto& b) {
    return a.first->names[a.second] / count < b.first->names[b.second] / count;
  });
  for (const auto& [part, number] : rows) {
    const Eigen::Index columns = part->jacobian.size() / part->names.size();
    all.add(part->distances[number], part->names[number], columns) =
        Eigen::Map<const Eigen::RowVectorXd>(part->jacobian.data() + number * columns, columns);
  }
  return all;
}

}  // namespace ff
