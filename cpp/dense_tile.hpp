// Vectors and register tiles of the dense kernels; included by dense_kernels.hpp, once for every instruction set.
#include <cstdint>
#include <cstring>

namespace teamslam::TEAMSLAM_KERNEL {
namespace {

#if defined(__GNUC__) || defined(__clang__)
typedef double Vector __attribute__((vector_size(32)));
inline Vector broadcast(double x) { return Vector{x, x, x, x}; }
#if defined(TEAMSLAM_WIDE)
typedef double WideVector __attribute__((vector_size(64)));
#endif
#else
struct Vector {
  double v[4];
};
inline Vector broadcast(double x) { return {{x, x, x, x}}; }
inline Vector operator*(Vector a, Vector b) {
  for (int i = 0; i < 4; ++i) a.v[i] *= b.v[i];
  return a;
}
inline Vector operator+(Vector a, Vector b) {
  for (int i = 0; i < 4; ++i) a.v[i] += b.v[i];
  return a;
}
inline Vector operator-(Vector a, Vector b) {
  for (int i = 0; i < 4; ++i) a.v[i] -= b.v[i];
  return a;
}
#endif

// Not std::min: an inline function shared with other files must not be compiled for this instruction set.
inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
inline int64_t most(int64_t a, int64_t b) { return a < b ? b : a; }

template <class V = Vector>
inline V load(const double* p) {
  V v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
template <class V>
inline void store(double* p, V v) {
  std::memcpy(p, &v, sizeof v);
}
template <class V>
inline V all(double x) {
  if constexpr (sizeof(V) == sizeof(Vector)) {
    return broadcast(x);
  } else {
    return V{x, x, x, x, x, x, x, x};
  }
}

// G vectors of rows by N columns.
template <int G, int N, class V = Vector>
struct Tile {
  static constexpr int lanes = sizeof(V) / sizeof(double);
  V at[N][G];

  inline void read(const double* c, int64_t leading) {
    for (int j = 0; j < N; ++j)
      for (int g = 0; g < G; ++g) at[j][g] = load<V>(c + j * leading + lanes * g);
  }
  inline void write(double* c, int64_t leading) const {
    for (int j = 0; j < N; ++j)
      for (int g = 0; g < G; ++g) store(c + j * leading + lanes * g, at[j][g]);
  }
  inline void subtract(int64_t inner, const double* a, int64_t a_leading, const double* b, int64_t b_inner,
                       int64_t b_column) {
    for (int64_t p = 0; p < inner; ++p) {
      V rows[G];
      for (int g = 0; g < G; ++g) rows[g] = load<V>(a + lanes * g);
      for (int j = 0; j < N; ++j) {
        const V x = all<V>(b[j * b_column]);
        for (int g = 0; g < G; ++g) at[j][g] = at[j][g] - rows[g] * x;
      }
      a += a_leading;
      b += b_inner;
    }
  }
  // at = at * T^-T, T the N x N lower triangle at t.
  inline void divide_transposed(const double* t, int64_t leading, const double* inverse) {
    for (int j = 0; j < N; ++j) {
      for (int q = 0; q < j; ++q) {
        const Vector x = broadcast(t[j + q * leading]);
        for (int g = 0; g < G; ++g) at[j][g] = at[j][g] - at[q][g] * x;
      }
      const Vector x = broadcast(inverse[j]);
      for (int g = 0; g < G; ++g) at[j][g] = at[j][g] * x;
    }
  }
  // at = at * T^-1.
  inline void divide(const double* t, int64_t leading, const double* inverse) {
    for (int j = N - 1; j >= 0; --j) {
      for (int q = j + 1; q < N; ++q) {
        const Vector x = broadcast(t[q + j * leading]);
        for (int g = 0; g < G; ++g) at[j][g] = at[j][g] - at[q][g] * x;
      }
      const Vector x = broadcast(inverse[j]);
      for (int g = 0; g < G; ++g) at[j][g] = at[j][g] * x;
    }
  }
};

// Calls body.operator()<G>(row) over all rows, in tiles of TEAMSLAM_TILE groups and smaller ones at the end.
template <class Body>
inline void over_rows(int64_t begin, int64_t end, const Body& body) {
  constexpr int G = TEAMSLAM_TILE;
  int64_t i = begin;
  for (; i + 4 * G <= end; i += 4 * G) body.template operator()<G>(i);
  if constexpr (G > 2) {
    if (i + 8 <= end) {
      body.template operator()<2>(i);
      i += 8;
    }
  }
  for (; i < end; i += 4) body.template operator()<1>(i);
}

// The same with wide vectors, where there are, as long as tiles of them are full: body.operator()<V, G>(row).
template <class Body>
inline void over_tiles(int64_t begin, int64_t end, const Body& body) {
  int64_t i = begin;
#if defined(TEAMSLAM_WIDE)
  for (; i + 24 <= end; i += 24) body.template operator()<WideVector, 3>(i);
  for (; i + 8 <= end; i += 8) body.template operator()<WideVector, 1>(i);
#endif
  over_rows(i, end, [&]<int G>(int64_t row) { body.template operator()<Vector, G>(row); });
}

// How many of `columns` are taken together: `most` where there are as many, then 4, then the rest.
template <int most>
inline int64_t block_width(int64_t columns) {
  return columns >= most ? most : columns >= 4 ? 4 : columns;
}

// Calls body.operator()<N>() with N the width of the next block of columns, 1 .. 4 or `most`.
template <int most = 4, class Body>
inline void with_columns(int64_t columns, const Body& body) {
  if (most > 4 && columns >= most) {
    body.template operator()<most>();
  } else if (columns >= 4) {
    body.template operator()<4>();
  } else if (columns == 3) {
    body.template operator()<3>();
  } else if (columns == 2) {
    body.template operator()<2>();
  } else if (columns == 1) {
    body.template operator()<1>();
  }
}

}  // namespace
}  // namespace teamslam::TEAMSLAM_KERNEL
