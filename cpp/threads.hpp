// A team of threads that run one function together, with barriers: the kernel's only form of parallelism.
//
// The threads are started once and wait between calls. Work is shared out so that results do not depend on the size of
// the team, and whoever finds the team busy simply works alone, with the same result.
#pragma once

#include <atomic>
#include <functional>

namespace teamslam {

class Team {
 public:
  Team(int index, int size, std::atomic<int>* arrived) : index_(index), size_(size), arrived_(arrived) {}
  int index() const { return index_; }
  int size() const { return size_; }
  // Waits until every member has called it as often.
  void barrier() {
    if (size_ > 1) wait();
  }

 private:
  void wait();

  int index_, size_;
  std::atomic<int>* arrived_;
  int target_ = 0;
};

// Runs body on up to `threads` threads, the caller being member 0; returns when all have finished. What a
// member throws is thrown again by the caller; a body that throws must not use barriers.
void run_team(int threads, const std::function<void(Team&)>& body);

}  // namespace teamslam
