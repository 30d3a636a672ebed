// Memory that is kept between factors: see buffer.hpp.
#include "buffer.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <mutex>
#include <new>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace teamslam {
namespace {

constexpr int64_t page = 512;                  // doubles
constexpr int64_t worth_keeping = 8 * page;    // below, the system's own lists do as well
constexpr int64_t most_kept = int64_t{8} << 20;  // doubles, all together: 64 MiB
constexpr size_t most_pieces = 64;

double* fresh(int64_t doubles) {
  const size_t size = sizeof(double) * static_cast<size_t>(doubles);
  void* memory = nullptr;
#if defined(__linux__)
  constexpr size_t large_page = size_t{1} << 21;
  if (size >= 2 * large_page) {
    const size_t whole = (size + large_page - 1) & ~(large_page - 1);
    memory = std::aligned_alloc(large_page, whole);
    if (memory != nullptr) madvise(memory, whole, MADV_HUGEPAGE);  // a wish: where it is not granted, small pages do
  }
#endif
  if (memory == nullptr) memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  return static_cast<double*>(memory);
}

// What was given back, the latest last. Giving back must not fail, so that there is room for all pieces from the start.
class Shelf {
 public:
  Shelf() { kept_.reserve(most_pieces); }

  // A piece that is large enough and not much larger, or null.
  Buffer take(int64_t doubles) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (size_t i = kept_.size(); i-- > 0;) {
      const Piece piece = kept_[i];
      if (piece.doubles < doubles || piece.doubles > 2 * doubles) continue;
      kept_.erase(kept_.begin() + static_cast<std::ptrdiff_t>(i));
      total_ -= piece.doubles;
      return Buffer(piece.memory, GiveBack{piece.doubles});
    }
    return nullptr;
  }

  // Keeps a piece, and drops the oldest ones where all together are too much.
  void put(double* memory, int64_t doubles) {
    const std::lock_guard<std::mutex> lock(mutex_);
    size_t dropped = 0;
    for (; kept_.size() - dropped == most_pieces || total_ + doubles > most_kept; ++dropped) {
      total_ -= kept_[dropped].doubles;
      std::free(kept_[dropped].memory);
    }
    kept_.erase(kept_.begin(), kept_.begin() + static_cast<std::ptrdiff_t>(dropped));
    kept_.push_back({memory, doubles});
    total_ += doubles;
  }

 private:
  struct Piece {
    double* memory;
    int64_t doubles;
  };

  std::mutex mutex_;
  std::vector<Piece> kept_;
  int64_t total_ = 0;
};

// Never destroyed: factors may outlive static destruction.
Shelf& shelf() {
  static auto* found = new Shelf;
  return *found;
}

}  // namespace

void GiveBack::operator()(double* memory) const {
  if (capacity < worth_keeping || capacity > most_kept) {
    std::free(memory);
  } else {
    shelf().put(memory, capacity);
  }
}

Buffer buffer(int64_t doubles) {
  const int64_t capacity = std::max((doubles + page - 1) / page, int64_t{1}) * page;
  if (capacity >= worth_keeping && capacity <= most_kept) {
    if (Buffer kept = shelf().take(capacity)) return kept;
  }
  return Buffer(fresh(capacity), GiveBack{capacity});
}

}  // namespace teamslam
