// A team of threads that run one function together: the kernel's only form of parallelism.
//
// The threads are started once and sleep between calls. Work is shared out so that results do not depend on the size of
// the team. On a busy machine a thread may be late by milliseconds, so nobody waits for one that has not come: whoever
// finds the door closed stays out. A caller who lost much time waiting for others works alone for a while, and one who
// finds the team busy works alone at once, with the same result.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

namespace teamslam {

// What the members of a team share.
struct Muster {
  std::atomic<int> arrived{0};  // calls of barrier by all members together
  std::atomic<int> size{0};     // of the team, once the door is closed
};

class Team {
 public:
  // A team of one.
  Team() = default;
  Team(int index, Muster* muster) : index_(index), size_(0), muster_(muster) {}

  int index() const { return index_; }
  // Closes the door: those who have come so far are the team. Before size and barrier are used, every member calls it.
  void gather();
  int size() const { return size_; }
  // Seconds that this member has spent in barriers.
  double waited() const { return waited_; }
  // Waits until every member has called it as often.
  void barrier() {
    if (size_ > 1) wait();
  }

 private:
  void wait();

  int index_ = 0, size_ = 1;
  Muster* muster_ = nullptr;
  int target_ = 0;
  double waited_ = 0.0;
};

// Runs body on up to `threads` threads, the caller being member 0; returns when all who came have finished. What a
// member throws is thrown again by the caller; a body that throws must not gather.
void run_team(int threads, const std::function<void(Team&)>& body);

// Runs body(i) for 0 <= i < count on up to `threads` threads; whichever is idle takes the next. Of what is thrown, the
// caller gets that of the lowest i.
void share_out(int64_t count, int threads, const std::function<void(int64_t)>& body);

}  // namespace teamslam
