// Two numbers side by side, which every processor adds and multiplies at once. Compilers find such pairs in some loops
// only; where a loop is hot they are written out.
#pragma once

#include <cstring>

namespace teamslam {

#if defined(__GNUC__) || defined(__clang__)
typedef double Pair __attribute__((vector_size(16)));
#else
struct Pair {
  double v[2];
};
inline Pair operator*(double a, Pair x) { return {{a * x.v[0], a * x.v[1]}}; }
inline Pair operator+(Pair x, Pair y) { return {{x.v[0] + y.v[0], x.v[1] + y.v[1]}}; }
#endif

// Number i of an array of numbers or of pairs.
template <class Lane>
inline Lane lane(const double* p, int i) {
  Lane x;
  std::memcpy(&x, p + i * (sizeof(Lane) / sizeof(double)), sizeof x);
  return x;
}
template <class Lane>
inline void set_lane(double* p, int i, Lane x) {
  std::memcpy(p + i * (sizeof(Lane) / sizeof(double)), &x, sizeof x);
}

}  // namespace teamslam
