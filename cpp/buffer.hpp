// Uninitialised arrays of doubles, owned. Large ones ask for large pages: a factor is written once from end to end, and
// on small pages a good part of that time goes into page faults.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace teamslam {

struct FreeBuffer {
  void operator()(double* memory) const { std::free(memory); }
};

using Buffer = std::unique_ptr<double[], FreeBuffer>;

inline Buffer buffer(int64_t doubles) {
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
  if (memory == nullptr) memory = std::malloc(size > 0 ? size : 1);
  if (memory == nullptr) throw std::bad_alloc();
  return Buffer(static_cast<double*>(memory));
}

}  // namespace teamslam
