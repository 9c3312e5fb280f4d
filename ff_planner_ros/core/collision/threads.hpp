// The distances of many pairs along a path, shared among threads.
#pragma once
#ifdef __linux__
#include <sched.h>
#endif

#include <algorithm>
#include <future>

#include "collision/bodies.hpp"
#include "kinematics/deadline.hpp"

namespace ff {

// To begin and to join a thread takes as long as so many distances, nearly all of which are too far
// to be of interest; below, several were slower than one.
constexpr size_t kPairsOfAThread = 4000;
// Rows are put together by one thread: more share little of what is left.
constexpr size_t kMostThreads = 4;

// The cores that this process may use.
size_t usable_cores();

// Rows of several parts in order of the configurations, then of the parts; count: of the names of a
// configuration.
DistanceRows joined(const std::vector<DistanceRows>& parts, long long count);

// What `rows_of(first, last)` finds for pairs of bodies by their numbers, each at all
// configurations: the same for any number of threads. It must write nothing that pairs share.
template <typename RowsOf>
DistanceRows rows_in_threads(size_t pairs, size_t configurations, long long count,
                             const RowsOf& rows_of) {
  const size_t wanted = pairs * configurations / kPairsOfAThread;
  const size_t threads = wanted < 2 ? 1 : std::min({wanted, kMostThreads, usable_cores(), pairs});
  if (threads == 1) return rows_of(0, pairs);
  const Deadline::Time end = Deadline::end();
  const auto part_of = [&rows_of, end](size_t first, size_t last) {
    const Deadline deadline(end);
    return rows_of(first, last);
  };
  // Where the system has no more threads, this one does their parts, too.
  const auto policy = std::launch::async | std::launch::deferred;
  std::vector<std::future<DistanceRows>> others;
  for (size_t part = 1; part < threads; ++part)
    others.push_back(
        std::async(policy, part_of, part * pairs / threads, (part + 1) * pairs / threads));
  std::vector<DistanceRows> parts{rows_of(0, pairs / threads)};
  for (std::future<DistanceRows>& other : others) parts.push_back(other.get());
  return joined(parts, count);
}

}  // namespace ff
