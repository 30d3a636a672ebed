// Uninitialised arrays of doubles, owned: what factors are made of.
//
// Fresh memory is slow: the system clears every page of it when it is first touched, which may take as long as a small
// factorisation. So memory that is given back is kept for the next factor, up to a limit; and what is large asks for
// large pages.
#pragma once

#include <cstdint>
#include <memory>

namespace teamslam {

struct GiveBack {
  int64_t capacity = 0;  // doubles
  void operator()(double* memory) const;
};

using Buffer = std::unique_ptr<double[], GiveBack>;

Buffer buffer(int64_t doubles);

}  // namespace teamslam
