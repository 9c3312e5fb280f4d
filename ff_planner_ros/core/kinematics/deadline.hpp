// The end of the time that a computation may take, which its long loops keep.
#pragma once
#include <chrono>
#include <stdexcept>

namespace ff {

struct DeadlineOver : std::runtime_error {
  DeadlineOver() : std::runtime_error("the deadline is over") {}
};

// The deadline of what a thread computes while this lives.
class Deadline {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit Deadline(Time end) : before_(end_) { end_ = end; }
  ~Deadline() { end_ = before_; }
  Deadline(const Deadline&) = delete;
  Deadline& operator=(const Deadline&) = delete;

  // That of this thread, for others that compute for it.
  static Time end() { return end_; }

  // Throws DeadlineOver if it is over, which takes as long as a few products of vectors.
  static void require() {
    if (end_ != Time::max() && std::chrono::steady_clock::now() >= end_) throw DeadlineOver();
  }

 private:
  static inline thread_local Time end_ = Time::max();
  const Time before_;
};

}  // namespace ff
