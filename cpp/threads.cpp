// The persistent threads behind run_team.
#include "threads.hpp"

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

constexpr int spins = 4000;  // a few microseconds before giving the processor away

inline void relax() {
#if defined(__x86_64__) && defined(__GNUC__)
  __builtin_ia32_pause();
#endif
}

class Pool {
 public:
  void run(int threads, const std::function<void(Team&)>& body) {
    while (static_cast<int>(workers_.size()) < threads - 1) {
      const int index = static_cast<int>(workers_.size()) + 1;
      workers_.emplace_back([this, index, seen = generation_] { serve(index, seen); });
      workers_.back().detach();
    }
    arrived_.store(0, std::memory_order_relaxed);
    running_.store(threads - 1, std::memory_order_relaxed);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      body_ = &body;
      size_ = threads;
      ++generation_;
    }
    wake_.notify_all();
    attempt(body, 0, threads);
    for (int i = 0; running_.load(std::memory_order_acquire) != 0; ++i) {
      i < spins ? relax() : std::this_thread::yield();
    }
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

  std::mutex busy;

 private:
  void attempt(const std::function<void(Team&)>& body, int index, int size) {
    Team team(index, size, &arrived_);
    try {
      body(team);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex_);
      failure_ = std::current_exception();
    }
  }

  void serve(int index, long seen) {
    for (;;) {
      const std::function<void(Team&)>* body = nullptr;
      int size = 0;
      {
        std::unique_lock<std::mutex> lock(mutex_);
        wake_.wait(lock, [&] { return generation_ != seen; });
        seen = generation_;
        body = body_;
        size = size_;
      }
      if (index >= size) continue;
      attempt(*body, index, size);
      running_.fetch_sub(1, std::memory_order_release);
    }
  }

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::exception_ptr failure_;
  std::condition_variable wake_;
  const std::function<void(Team&)>* body_ = nullptr;
  int size_ = 0;
  long generation_ = 0;
  std::atomic<int> arrived_{0}, running_{0};
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

void Team::wait() {
  target_ += size_;
  arrived_->fetch_add(1, std::memory_order_acq_rel);
  for (int i = 0; arrived_->load(std::memory_order_acquire) < target_; ++i) {
    i < spins ? relax() : std::this_thread::yield();
  }
}

void run_team(int threads, const std::function<void(Team&)>& body) {
  if (threads > 1) {
    Pool& shared = pool();
    const std::unique_lock<std::mutex> lock(shared.busy, std::try_to_lock);
    if (lock.owns_lock()) {
      shared.run(threads, body);
      return;
    }
  }
  Team alone(0, 1, nullptr);
  body(alone);
}

}  // namespace teamslam
