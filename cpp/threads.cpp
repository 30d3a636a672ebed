// The persistent threads behind run_team.
#include "threads.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#endif

namespace teamslam {
namespace {

constexpr int spins = 1000;  // some 50 microseconds before going to sleep

inline void relax() {
#if defined(__x86_64__) && defined(__GNUC__)
  __builtin_ia32_pause();
#endif
}

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <class Done>
void await(const std::atomic<int>& word, const Done& done) {
  for (int i = 0;; ++i) {
    const int value = word.load(std::memory_order_acquire);
    if (done(value)) return;
    i < spins ? relax() : word.wait(value, std::memory_order_acquire);
  }
}

class Pool {
 public:
  void run(int threads, const std::function<void(Team&)>& body) {
    while (static_cast<int>(workers_.size()) < threads - 1) {
      workers_.emplace_back([this, seen = generation_] { serve(seen); });
      workers_.back().detach();
    }
    muster_.arrived.store(0, std::memory_order_relaxed);
    muster_.size.store(0, std::memory_order_relaxed);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      body_ = &body;
      most_ = threads;
      came_ = 1;
      ++generation_;
    }
    wake_.notify_all();
    const double began = now(), in_barriers = attempt(body, 0), done = now();
    close();
    await(inside_, [](int count) { return count == 0; });
    const double ended = now();
    learn(in_barriers + (ended - done), ended - began);
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

  // Nobody comes in any more; how many have.
  int close() {
    const std::lock_guard<std::mutex> lock(mutex_);
    most_ = 0;
    return came_;
  }

  // Whether the caller should work alone this time, because sharing has not paid lately.
  bool rests() { return resting_ > 0 && resting_-- > 0; }

  std::mutex busy;

 private:
  // On a machine with other work, a member that is not running holds all others up. Each time that this took most of the
  // time of a call, twice as many calls as before are made alone.
  void learn(double waited, double total) {
    constexpr int longest = 64;
    constexpr double harmless = 2e-4;  // seconds
    patience_ = waited > harmless && 2.0 * waited > total ? std::min(longest, 2 * patience_ + 2) : 0;
    resting_ = patience_;
  }

  // Seconds spent in barriers.
  double attempt(const std::function<void(Team&)>& body, int index) {
    Team team(index, &muster_);
    try {
      body(team);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex_);
      failure_ = std::current_exception();
    }
    return team.waited();
  }

  void serve(long seen) {
    for (;;) {
      const std::function<void(Team&)>* body = nullptr;
      int index = 0;
      {
        std::unique_lock<std::mutex> lock(mutex_);
        wake_.wait(lock, [&] { return generation_ != seen && came_ < most_; });
        seen = generation_;
        body = body_;
        index = came_++;
        inside_.fetch_add(1, std::memory_order_relaxed);
      }
      attempt(*body, index);
      if (inside_.fetch_sub(1, std::memory_order_acq_rel) == 1) inside_.notify_all();
    }
  }

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::exception_ptr failure_;
  std::condition_variable wake_;
  const std::function<void(Team&)>* body_ = nullptr;
  int most_ = 0;  // members that may come in; 0: the door is closed
  int came_ = 0;
  long generation_ = 0;
  std::atomic<int> inside_{0};  // members besides the caller
  int resting_ = 0, patience_ = 0;  // calls still to be made alone, and how many the last time
  Muster muster_;
};

// Never destroyed: its threads may outlive static destruction. A forked child has none of them and starts its own.
std::atomic<Pool*> current{nullptr};

Pool& pool() {
  Pool* found = current.load(std::memory_order_acquire);
  if (found != nullptr) return *found;
  auto* fresh = new Pool;
  if (current.compare_exchange_strong(found, fresh)) {
#if defined(__unix__) || defined(__APPLE__)
    static std::once_flag once;
    std::call_once(once, [] { pthread_atfork(nullptr, nullptr, [] { current.store(nullptr); }); });
#endif
    return *fresh;
  }
  delete fresh;
  return *found;
}

}  // namespace

void Team::gather() {
  if (muster_ == nullptr) return;
  if (index_ == 0) {
    size_ = pool().close();
    muster_->size.store(size_, std::memory_order_release);
    muster_->size.notify_all();
  } else {
    await(muster_->size, [](int size) { return size > 0; });
    size_ = muster_->size.load(std::memory_order_acquire);
  }
}

void Team::wait() {
  target_ += size_;
  if (muster_->arrived.fetch_add(1, std::memory_order_acq_rel) + 1 == target_) {
    muster_->arrived.notify_all();
    return;
  }
  const double began = now();
  await(muster_->arrived, [this](int arrived) { return arrived >= target_; });
  waited_ += now() - began;
}

void run_team(int threads, const std::function<void(Team&)>& body) {
  if (threads > 1) {
    Pool& shared = pool();
    const std::unique_lock<std::mutex> lock(shared.busy, std::try_to_lock);
    if (lock.owns_lock() && !shared.rests()) {
      shared.run(threads, body);
      return;
    }
  }
  Team alone;
  body(alone);
}

void share_out(int64_t count, int threads, const std::function<void(int64_t)>& body) {
  if (count <= 1 || threads <= 1) {
    for (int64_t i = 0; i < count; ++i) body(i);
    return;
  }
  std::atomic<int64_t> next{0};
  std::mutex failing;
  int64_t failed = count;
  std::exception_ptr failure;
  run_team(static_cast<int>(std::min<int64_t>(threads, count)), [&](Team&) {
    for (int64_t i = next++; i < count; i = next++) try {
        body(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(failing);
        if (i < failed) failed = i, failure = std::current_exception();
      }
  });
  if (failure) std::rethrow_exception(failure);
}

}  // namespace teamslam
